// The hand that pulls while the scene runs: a spring from what it holds to where it is, given as signals of the scene.

import { compliance } from "./compliance.js";
import { Run } from "./simulate.js";

const PERIOD = 0.5; // s on the clock of the reader: in which what is held would swing once, if nothing but inertia held it
const DIGITS = 7; // of what is remembered of a pull, so that an address gives the same run
const SLIGHT = 1e-6; // stiffness with which a force is tried: it is then the same wherever the part goes

const short = (value) => Number(value.toPrecision(DIGITS));

/** Signals of a hand that pulls no more. */
const nothing = (hand) => hand.signals.map(() => 0);

/** What `Run` reads of pulls [t, hand, signals], as an address has them. */
export function pullsOf(hands, pulls) {
  const byName = new Map(hands.map((hand) => [hand.name, hand]));
  return pulls.flatMap(([t, name, signals]) => {
    const hand = byName.get(name);
    return hand === undefined ? [] : [[t, hand.signals.map((register, k) => [register, signals[k] ?? 0])]];
  });
}

/** A run with a hand in it. */
export class Pull {
  /** `grip` is {hand, end, move, item, vertex, motion, read, speed}; `read(w)` are the values that move the picture. */
  constructor(repeater, { times, values, initial, pulls }, grip, t) {
    Object.assign(this, { repeater, grip, hands: repeater.scene.data.hands, log: pulls.filter(([time]) => time < t) });
    this.run = new Run(repeater.scene, times, repeater.registers, { initial, pulls: pullsOf(this.hands, this.log) });
    this.run.horizon = short(t);
    this.stretches = this.run.stretches(repeater.slotsOf(values));
    this.place = [];
    this.advance();
    if (this.done) return;
    this.place = this.placeOnFrame();
    this.stiffness = this.stiffnessThere();
  }

  advance() {
    const { value, done } = this.stretches.next();
    if (!done) this.now = value;
    this.done = done;
  }

  observed() {
    return this.run.observed(this.now.t, this.now.x);
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

  /** Where what is held is: one coordinate, or the two of the point in the plane. */
  held(w) {
    const { hand } = this.grip;
    const [x, y, theta] = hand.potentials.map((register) => w[register]);
    if (hand.kind === "point") return [x, y];
    if (hand.kind !== "frame") return [x];
    const [rx, ry] = this.place;
    const [c, s] = [Math.cos(theta), Math.sin(theta)];
    return [x + c * rx - s * ry, y + s * rx + c * ry];
  }

  /** The stiffness of the hand: such that what it holds swings once in its period; 0 where that cannot move. */
  stiffnessThere() {
    const { run, now, grip, place } = this;
    const [none, begun] = [nothing(grip.hand), this.held(this.observed())];
    const put = (signals) => run.put(grip.hand.signals.map((register, k) => [register, signals[k]]));
    const push = (force) => put([SLIGHT, ...begun.map((v, k) => v + force[k] / SLIGHT), ...place]);
    const placeAt = (x) => this.held(run.observed(now.t, x));
    const { order, value } = compliance(run.scene, now, begun.length, placeAt, push);
    put(none);
    const stiffness = ((2 * Math.PI) / (PERIOD * grip.speed)) ** order / value;
    return Number.isFinite(stiffness) && stiffness > 0 ? short(stiffness) : 0;
  }

  /** A place of the picture of a scene in the plane, in the scene. */
  inModel([px, py]) {
    const { end, motion } = this.grip;
    const [across, up] = [end.moves.find((m) => m.dx !== 0 && m.dy === 0), end.moves.find((m) => m.dy !== 0 && m.dx === 0)];
    const zero = (move) => move.reference ?? motion.references[motion.index.get(move.variable)];
    return [zero(across) + (px - end.x) / across.dx, zero(up) + (py - end.y) / up.dy];
  }

  /** The signals with which the hand pulls towards a place of the picture. */
  signals(to) {
    const { hand, move, item, vertex, motion, read } = this.grip;
    if (hand.kind === "point" || hand.kind === "frame") return [this.stiffness, ...this.inModel(to).map(short), ...this.place];
    const w = this.observed();
    const values = read(w);
    const way = motion.way(item, move, motion.point(item, vertex, values), to, values);
    return [this.stiffness, short(w[hand.potentials[0]] + way)];
  }

  /** Pull towards a place, and go on to a time: what moves the picture there, where the hand holds, and the registers. */
  to(place, t) {
    if (this.done) return null;
    this.add(this.signals(place));
    this.run.horizon = Math.max(short(t), this.now.t);
    if (this.run.horizon > this.now.t) this.advance();
    if (this.done) return null;
    const { motion, item, vertex, read } = this.grip;
    const w = this.observed();
    const places = read(w);
    return { places, at: motion.point(item, vertex, places), w };
  }

  add(signals) {
    const entry = [this.now.t, this.grip.hand.name, signals];
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
