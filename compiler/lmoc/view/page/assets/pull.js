// The hand that pulls while the scene runs: a spring from what it holds to where it is, given as signals of the scene.

import { Run } from "./simulate.js";

const PERIOD = 0.5; // s on the clock of the reader: in which what is held alone would swing once
const DIGITS = 7; // of what is remembered of a pull, so that an address gives the same run

const short = (value) => Number(value.toPrecision(DIGITS));

/** Signals of a hand that pulls no more. */
const nothing = (hand) => hand.signals.map(() => 0);

/** What `Run` reads of pulls [t, part, signals], as an address has them. */
export function pullsOf(hands, pulls) {
  const byPart = new Map(hands.map((hand) => [hand.part, hand]));
  return pulls.flatMap(([t, part, signals]) => {
    const hand = byPart.get(part);
    return hand === undefined ? [] : [[t, hand.signals.map((register, k) => [register, signals[k] ?? 0])]];
  });
}

/** A run with a hand in it. */
export class Pull {
  /** `grip` is {hand, item, vertex, motion, read, speed}; `read(w)` are the values that move the picture. */
  constructor(repeater, { times, values, initial, pulls }, grip, t) {
    Object.assign(this, { repeater, grip, hands: repeater.scene.data.hands, log: pulls.filter(([time]) => time < t) });
    this.run = new Run(repeater.scene, times, repeater.registers, { initial, pulls: pullsOf(this.hands, this.log) });
    this.run.horizon = short(t);
    this.stretches = this.run.stretches(repeater.slotsOf(values));
    this.stiffness = short((grip.hand.inertia || 1) * ((2 * Math.PI) / (PERIOD * grip.speed)) ** 2);
    this.advance();
    this.place = this.now === undefined ? [] : this.placeOnFrame();
  }

  advance() {
    const { value, done } = this.stretches.next();
    if (!done) this.now = value;
    this.done = done;
  }

  observed() {
    return this.repeater.scene.observe(this.now.t, this.now.x);
  }

  /** Where on a frame the hand holds it. */
  placeOnFrame() {
    const { hand, item, vertex, motion, read } = this.grip;
    if (hand.kind !== "frame") return [];
    const w = this.observed();
    const [x, y, theta] = hand.potentials.map((register) => w[register]);
    const [px, py] = this.inModel(motion.point(item, vertex, read(w)), read(w));
    const [c, s] = [Math.cos(theta), Math.sin(theta)];
    return [c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)].map(short);
  }

  /** A place of the picture of a scene in the plane, in the scene. */
  inModel([px, py]) {
    const { item, motion } = this.grip;
    const [end] = item.ends;
    const [across, up] = [end.moves.find((m) => m.dx !== 0 && m.dy === 0), end.moves.find((m) => m.dy !== 0 && m.dx === 0)];
    const zero = (move) => move.reference ?? motion.references[motion.index.get(move.variable)];
    return [across ? zero(across) + (px - end.x) / across.dx : 0, up ? zero(up) + (py - end.y) / up.dy : 0];
  }

  /** The signals with which the hand pulls towards a place of the picture. */
  signals(to) {
    const { hand, item, vertex, motion, read } = this.grip;
    const w = this.observed();
    if (hand.kind === "point" || hand.kind === "frame") return [this.stiffness, ...this.inModel(to).map(short), ...this.place];
    const values = read(w);
    const at = motion.point(item, vertex, values);
    const way = motion.way(item, at, to, values);
    return [this.stiffness, short(w[hand.potentials[0]] + way)];
  }

  /** Pull towards a place, and go on to a time; the values of the registers there. */
  to(place, t) {
    if (this.done) return null;
    this.add(this.signals(place));
    this.run.horizon = Math.max(short(t), this.now.t);
    if (this.run.horizon > this.now.t) this.advance();
    if (this.done) return null;
    const w = this.observed();
    return { t: this.now.t, w, at: this.grip.motion.point(this.grip.item, this.grip.vertex, this.grip.read(w)) };
  }

  add(signals) {
    const entry = [this.now.t, this.grip.hand.part, signals];
    if (this.log.length && this.log.at(-1).slice(1).join() === entry.slice(1).join()) return; // it has not moved
    this.log.push(entry);
    this.run.pulls.push(...pullsOf(this.hands, [entry]));
  }

  /** Let go: the answer of the whole run. */
  letGo() {
    if (!this.done) {
      this.add(nothing(this.grip.hand));
      this.run.horizon = Infinity;
      while (!this.done) this.advance();
    }
    const result = this.run.result();
    return { ...this.repeater.answer(result.time, result.columns, result), pulls: this.log };
  }
}
