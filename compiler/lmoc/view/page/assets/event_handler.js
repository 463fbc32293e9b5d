// The events of a run: when the next one comes, its effect, and its record, as `numerics/events/event_handler.py`.

import { nextTime, ring } from "./clock.js";
import { DiscreteState, nearTo } from "./discrete_state.js";
import { Stopped } from "./stopped.js";

const CHANGES = 12; // of one condition …
const MOMENT = 1e-9; // … within this part of the run, which is chattering
const START_ROUNDS = 50; // of finding states and discrete values at the start that agree
const SHORTLY = 1e-2; // part of the time since the last crossing, over which the way from zero is looked at
const SEEN = 200; // times what its zero may be off, which a hop is higher than; a margin ends at 100 times itself
const STOPPED = 1e-3; // of the speed with which a function has come to zero, below which a jump has stopped it
const ULPS = 4 * 2 ** -52;
const LEAST_LOOKS = 120; // steps at least in a run with relations of time that are not linear in it
const CONTINUOUS = 1e-9; // share of a value by which it may change at an event and still be continuous

export class EventHandler {
  constructor(scene) {
    const { data } = scene;
    Object.assign(this, { scene, own: data.events, begin: data.begin, end: data.end });
    this.discrete = new DiscreteState(scene);
    this.records = [];
    this.next = Infinity;
    this.times = new Map(); // when each zero function has last crossed zero
  }

  /** States and discrete values that agree, behind what happens at the start. `states()` finds the states. */
  start(states) {
    const { discrete, begin } = this;
    let x = this.firstStates(states);
    discrete.literal = false;
    discrete.remember();
    this.next = nextTime(discrete, begin, true);
    return this.next <= begin + nearTo(begin) ? this.event(begin, x, "time") : x;
  }

  firstStates(states) {
    const { discrete, own, begin } = this;
    const { w, functions } = this.scene;
    this.flag(own.initial, 1);
    own.initialEquations.forEach(({ value, targets }, k) => {
      functions.initialEquations[k](begin);
      for (const target of targets) w[target] = w[value];
    });
    let x;
    for (let round = 0, changed = true; changed; round++) {
      if (round === START_ROUNDS) throw new Stopped("no states and discrete values agree at the start");
      const before = discrete.all();
      x = states();
      discrete.look(begin, x);
      own.before.forEach(([now, past], k) => {
        if (!own.held[k]) w[past] = discrete.value(now);
      });
      discrete.assign();
      changed = discrete.all().some((v, k) => v !== before[k] && !(Number.isNaN(v) && Number.isNaN(before[k])));
    }
    x = discrete.reinit(begin, x) ?? x;
    this.flag(own.initial, 0);
    discrete.remember();
    discrete.solve(begin, x);
    return x;
  }

  flag(register, value) {
    if (register >= 0) this.scene.w[register] = value;
  }

  /** s, where the present piece ends at the latest. */
  get until() {
    return Math.min(this.next, this.end);
  }

  get longestStep() {
    return this.own.looksAtTime ? (this.end - this.begin) / LEAST_LOOKS : Infinity;
  }

  /** Do what happens where a piece has ended; the states behind it, null at the end of the run. */
  after(t, x, roots) {
    const { discrete, own } = this;
    if (roots !== null) {
      const rounded = [...own.zeros.keys()].filter((k) => own.rounded[k]);
      const above = new Set(rounded.filter((_, i) => roots[own.zeros.length + i]));
      const crossed = [...own.zeros.keys()].filter((k) => roots[k] || above.has(k));
      this.noticeChatter(t, crossed);
      discrete.look(t, x);
      const at = new Map(crossed.map((k) => [k, discrete.zero(k)]));
      const behind = this.event(t, x, "when", () => this.turn(crossed, above));
      discrete.crossed(crossed);
      return behind === x ? behind : this.leave(t, x, behind, crossed, at);
    }
    if (t >= this.next - nearTo(t)) return this.event(t, x, "time");
    if (own.terminal >= 0 && this.scene.w[own.terminal] === 0) return this.event(t, x, "terminal");
    return null;
  }

  /** Let relations change that come to their change so soon that it is at this instant, though not there yet. */
  turn(crossed, above) {
    for (const k of crossed.filter((one) => !this.discrete.differs(one))) this.discrete.turn(k, above.has(k));
  }

  /** The next time event where it is as near to a time as that, else the time. */
  instant(t, near) {
    return Math.abs(this.next - t) <= near ? this.next : t;
  }

  /**
   * Let conditions at zero change back where the jump of states sends them to the side they came from. Where the way back
   * is too short to be told from none, the run ends: a ball would go on through its floor.
   */
  leave(t, before, x, crossed, at) {
    const { discrete, own, scene } = this;
    discrete.look(t, x);
    const near = crossed.filter((k) => {
      const now = discrete.zero(k);
      const stays = Math.abs(now) <= discrete.margin[k] || 2 * Math.abs(now - at.get(k)) <= Math.abs(at.get(k));
      return !own.rounded[k] && stays;
    });
    const since = t - Math.max(...near.map((k) => this.times.get(k).at(-2) ?? this.begin));
    if (near.length === 0 || !(since > 0)) return x;
    const short = SHORTLY * since;
    const [now, past] = [x, before].map((states) => this.ways(t, states, near, short));
    const noise = ULPS * Math.max(...x.map(Math.abs), ...before.map(Math.abs));
    const isUp = (k) => scene.w[own.zeroTargets[k]] > 0;
    const back = [];
    near.forEach((k, i) => {
      const { slope, height } = now[i];
      if (slope === 0 || slope > 0 === isUp(k)) return;
      const place = Math.max(2 * Math.abs(at.get(k)), Math.abs(slope) * nearTo(t));
      const moves = Math.abs(slope) > Math.max(noise / short, STOPPED * Math.abs(past[i].slope));
      if (height > SEEN * Math.max(place, noise)) {
        back.push(k);
        discrete.margin[k] = place;
      } else if (moves) {
        throw new Stopped(`'${own.texts[k]}' switches back and forth at t = ${t.toPrecision(6)} s: its next hop is too low to be seen`);
      }
    });
    discrete.look(t, x);
    if (back.length === 0) return x;
    return this.event(t, x, "when", () => {
      for (const k of back) scene.w[own.zeroTargets[k]] = 1 - scene.w[own.zeroTargets[k]];
    });
  }

  /** The slopes of zero functions, and how high they rise before they come back, as of `engine/c/hops.c`. */
  ways(t, x, zeros, short) {
    const { discrete, scene } = this;
    const rates = (time, states) => {
      const found = new Float64Array(x.length);
      scene.rates(time, states, found);
      return found;
    };
    const values = (time, states) => {
      discrete.look(time, states);
      return zeros.map((k) => discrete.zero(k));
    };
    const rate = rates(t, x);
    const along = (s, bend) => x.map((v, j) => v + s * rate[j] + 0.5 * s * s * bend[j]);
    const straight = new Float64Array(x.length);
    const next = rates(t + short, along(short, straight));
    const bend = rates(t - short, along(-short, straight)).map((v, j) => (next[j] - v) / (2 * short));
    const here = values(t, x);
    const [ahead, behind] = [short, -short].map((s) => values(t + s, along(s, straight)));
    const [on, back] = [short, -short].map((s) => values(t + s, along(s, bend)));
    return zeros.map((_, i) => {
      const slope = (ahead[i] - behind[i]) / (2 * short);
      const curvature = (on[i] - 2 * here[i] + back[i]) / short ** 2;
      return { slope, height: slope * curvature < 0 ? (0.5 * slope ** 2) / Math.abs(curvature) : Infinity };
    });
  }

  /** Do what follows from a change of the continuous equations at an instant. */
  settle(t, x) {
    return this.event(t, x, "when");
  }

  event(t, x, reason, change = () => {}) {
    const { discrete, own, scene } = this;
    const told = own.told.map(({ register }) => scene.w[register]);
    const held = discrete.all();
    discrete.time = t;
    const due = t >= this.next - nearTo(t); // also where something else has ended the piece at the same instant
    const instant = due ? this.next : t;
    const kind = due && reason === "when" ? "time" : reason;
    const happened = discrete.event(t, x, () => {
      if (due) ring(discrete, instant);
      if (kind === "terminal") this.flag(own.terminal, 1);
      change();
    });
    this.next = nextTime(discrete, instant);
    const lost = this.energy(t, x, happened);
    this.bookSteps(t, happened.x, held);
    this.tell(t, kind, happened, told, lost);
    for (const k of happened.broken) {
      if (own.checks[k].error) throw new Stopped(`an assertion does not hold: ${own.checks[k].message} (t = ${t.toPrecision(6)} s)`);
    }
    for (const k of happened.terminations) throw new Stopped(own.terminations[k].message, false);
    return happened.x;
  }

  /** Book what energy the jump of states has cost as heat, what it has brought as work; the loss. */
  energy(t, x, happened) {
    const { discrete, own } = this;
    if (happened.x === x || own.stored < 0 || own.work < 0 || own.heat < 0) return 0;
    const stored = (state) => {
      discrete.look(t, state);
      return discrete.value(own.stored);
    };
    const lost = stored(x) - stored(happened.x);
    if (!Number.isFinite(lost)) return lost;
    happened.x[lost > 0 ? own.heat : own.work] += Math.abs(lost);
    return Math.max(lost, 0);
  }

  /** Book the work of what steps at an instant; where the motion needs the derivative of the step, the run stops. */
  bookSteps(t, x, held) {
    const { discrete, scene } = this;
    const { registers, moving, stored, names } = this.own.jumps;
    if (registers.length === 0) return;
    const values = () => {
      scene.evaluate(scene.functions.jumps, t, x);
      return [...registers, ...stored].map((register) => scene.w[register]);
    };
    const now = discrete.all();
    discrete.put(held);
    const before = values();
    discrete.put(now);
    const after = values();
    const jumped = registers.map((_, k) => {
      return Math.abs(after[k] - before[k]) > CONTINUOUS * Math.max(Math.abs(after[k]), Math.abs(before[k]));
    });
    const wrong = jumped.findIndex((j, k) => j && moving[k]);
    if (wrong >= 0) {
      const what = `'${names[wrong]}' jumps at t = ${t.toPrecision(6)} s`;
      throw new Stopped(`${what}, and the motion needs its derivative, which is an impulse there`);
    }
    if (jumped.some(Boolean) && stored.length && this.own.work >= 0) x[this.own.work] += after.at(-1) - before.at(-1);
  }

  tell(t, kind, happened, told, loss) {
    const { own, scene } = this;
    let lost = loss;
    const add = (record) => this.records.push({ time: t, before: "", after: "", impulse: 0, energy_lost: 0, note: "", ...record });
    for (const k of happened.whens) {
      const { name, text } = own.whens[k];
      add({ name, kind: kind === "terminal" ? "when" : kind, after: text, energy_lost: lost });
      lost = 0;
    }
    own.told.forEach(({ register, name, boolean, hidden }, k) => {
      const now = scene.w[register];
      if (now === told[k] || (!hidden && happened.whens.size)) return;
      const shown = (value) => (boolean ? String(Boolean(value)) : String(Number(value.toPrecision(6))));
      add({ name, kind: hidden ? "relation" : "change", before: shown(told[k]), after: shown(now) });
    });
  }

  /** Stop where a condition switches again and again without the run getting on. */
  noticeChatter(t, crossed) {
    const moment = MOMENT * Math.max(this.end - this.begin, nearTo(t));
    for (const k of crossed) {
      const times = [...(this.times.get(k) ?? []), t].slice(-CHANGES);
      this.times.set(k, times);
      if (times.length === CHANGES && t - times[0] <= moment) {
        throw new Stopped(`'${this.own.texts[k]}' switches back and forth at t = ${t.toPrecision(6)} s`);
      }
    }
  }
}
