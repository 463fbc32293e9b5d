// The discrete side of a run: values of discrete variables, and the iteration at an event, as `numerics/events/discrete_state.py`.
//
// All variables stand in the registers of the scene: the discrete ones, and the continuous ones as last looked at.

import { Stopped } from "./stopped.js";

const OF_MAGNITUDE = 1e-14; // of a function's magnitude; the dense output of a step is no more exact
const MOST_ROUNDS = 100; // of solving at one instant, and of events that follow each other at it

/** A distance in time that does not count: some units of the last digit. */
export const nearTo = (t) => 4e-15 * Math.max(Math.abs(t), 1e-300);

/** By what the place of a root may be wrong: some units of the time's last digit, and of a sum of steps. */
export const located = (t, start) => 1e-14 * Math.max(Math.abs(t), Math.abs(start)) + 1e-12 * (t - start);

const differs = (a, b) => a !== b && !(Number.isNaN(a) && Number.isNaN(b));

function decide(op, zero) {
  if (op === "floor") return Math.floor(zero);
  return Number(op === "gt" ? zero > 0 : zero >= 0);
}

export class DiscreteState {
  constructor(scene) {
    this.scene = scene;
    this.own = scene.data.events;
    const { own } = this;
    this.time = scene.data.begin;
    // what a function that has just crossed zero may come back by rounding, and its largest magnitude since
    this.margin = new Float64Array(own.zeros.length);
    this.largest = new Float64Array(own.zeros.length);
    this.literal = true; // relations of time are taken as they are written, not as what they are right behind
    for (const register of own.discrete) scene.w[register] = 0;
    scene.functions.discreteStarts(this.time);
    this.remember();
  }

  get w() {
    return this.scene.w;
  }

  value(register) {
    return register < 0 ? NaN : this.scene.w[register];
  }

  zero(k) {
    return this.scene.w[this.own.zeros[k]];
  }

  all() {
    return this.own.discrete.map((register) => this.w[register]);
  }

  /** Put back the values of `all()`. */
  put(values) {
    this.scene.programs.switched();
    this.own.discrete.forEach((register, k) => (this.w[register] = values[k]));
  }

  /** Take the continuous values at a place. */
  look(t, x) {
    this.time = t;
    this.scene.evaluate(this.scene.functions.look, t, x);
  }

  /** pre(v) := v */
  remember() {
    this.own.before.forEach(([now, past]) => (this.w[past] = this.value(now)));
  }

  /** Carry out the discrete equations in their order. */
  assign() {
    const { functions } = this.scene;
    this.scene.functions.timed(this.time);
    for (const step of this.own.steps) {
      if (step.run !== undefined) functions.assign[step.run](this.time);
      else step.targets.forEach((target, i) => (this.w[target] = this.relation(step, target, i)));
      if (this.own.timed.length) functions.timed(this.time); // slopes and offsets may be discrete
    }
  }

  relation({ op, zeros, timed, rows }, target, i) {
    if (zeros !== null) return this.decided(op, zeros[i], this.w[target]);
    const own = this.own.timed[timed];
    const row = rows[i];
    if (this.literal) return decide(op, this.w[own.literal[row]]);
    const slope = this.w[own.slope[row]];
    const zero = slope * this.time + this.w[own.offset[row]];
    const nearest = op === "floor" ? Math.round(zero) : 0;
    const behind = nearest + Math.sign(slope) * 0.5; // any value on the side to which it goes
    const close = Math.abs(zero - nearest) <= Math.abs(slope) * nearTo(this.time) && slope !== 0;
    return decide(op, close ? behind : zero);
  }

  /** A relation from its zero function; within the margin of a crossing it stays as it is now. */
  decided(op, k, now) {
    const zero = this.zero(k);
    const beside = op === "floor" ? Math.max(now - zero, zero - now - 1) : Math.abs(zero);
    return beside < this.margin[k] ? now : decide(op, zero);
  }

  /** Whether a zero function, as last looked at, asks for another value than its relation has. */
  differs(k) {
    const now = this.w[this.own.zeroTargets[k]];
    return this.decided(this.own.zeroOps[k], k, now) !== now;
  }

  /** Find discrete values that agree with the continuous ones. */
  solve(t, x) {
    for (let round = 0; round < MOST_ROUNDS; round++) {
      this.look(t, x);
      const before = this.all();
      this.assign();
      if (!this.all().some((v, k) => differs(v, before[k]))) return;
      this.scene.programs.switched();
    }
    throw new Stopped(`no values satisfy all equations at t = ${t.toPrecision(6)} s`);
  }

  /**
   * Carry out everything that happens at an instant: {x, whens, terminations, broken}. `begin` is called when the values
   * before the event have been kept, to set what the event itself changes.
   */
  event(t, x, begin) {
    const { own, w } = this;
    const found = { x, whens: new Set(), terminations: [], broken: new Set() };
    this.look(t, x);
    for (let round = 0; round < MOST_ROUNDS; round++) {
      this.remember();
      if (round === 0) begin();
      this.scene.programs.switched();
      this.solve(t, found.x);
      own.whens.forEach((when, k) => {
        if (w[when.active]) found.whens.add(k);
      });
      this.scene.functions.judge(t);
      own.terminations.forEach((end, k) => {
        if (end.guards.some((register) => w[register])) found.terminations.push(k);
      });
      own.checks.forEach((check, k) => {
        if (w[check.register] === 0) found.broken.add(k);
      });
      const moved = this.reinit(t, found.x);
      for (const samples of own.samples) for (const register of samples.target) w[register] = 0;
      const changed = own.before.some(([now, past], k) => own.held[k] && differs(w[now], w[past]));
      if (moved === null && !changed) return found;
      found.x = moved ?? found.x;
      this.look(t, found.x);
    }
    throw new Stopped(`events follow each other without end at t = ${t.toPrecision(6)} s`);
  }

  /** The states with the values that `reinit` gives them; null where it gives none. */
  reinit(t, x) {
    const { own, w } = this;
    if (!own.reinits.some(({ guard }) => w[guard])) return null;
    const moved = Float64Array.from(x);
    this.scene.functions.reinits(t);
    for (const [one, wanted] of own.reinits.map((r) => [r, w[r.value]])) if (w[one.guard]) this.set(t, x, moved, one, wanted);
    return moved;
  }

  /** Change the state that a variable is, up to a factor and an offset. */
  set(t, x, moved, { state, seen, name }, wanted) {
    if (state >= 0) {
      moved[state] = wanted;
      return;
    }
    const at = (place) => {
      this.look(t, place);
      return this.value(seen);
    };
    const here = at(x);
    const slopes = [...x.keys()].map((j) => at(x.map((v, i) => (i === j ? v + 1 : v))) - here);
    this.look(t, x);
    const least = 1e-12 * slopes.reduce((most, s) => Math.max(most, Math.abs(s)), 0);
    const own = [...slopes.keys()].filter((j) => Math.abs(slopes[j]) > least);
    if (own.length !== 1) throw new Stopped(`'${name}' is given a new value by reinit, but is no state`);
    moved[own[0]] = x[own[0]] + (wanted - here) / slopes[own[0]];
  }

  /** Let a relation change whose function is about to cross zero, or the next whole number, above or below. */
  turn(k, upwards) {
    const target = this.own.zeroTargets[k];
    this.w[target] = this.own.rounded[k] ? this.w[target] + (upwards ? 1 : -1) : 1 - this.w[target];
    this.margin[k] = Math.max(this.margin[k], 2 * this.height(k, this.zero(k)), OF_MAGNITUDE * this.largest[k]);
  }

  /** Take note that functions have crossed zero: until they have left it, rounding does not bring them back. */
  crossed(zeros) {
    this.margin.forEach((margin, k) => {
      if (this.height(k, this.zero(k)) > margin) this.margin[k] = 0;
    });
    for (const k of zeros) {
      this.margin[k] = Math.max(OF_MAGNITUDE * this.largest[k], this.margin[k]);
      this.largest[k] = 0;
    }
  }

  /** The distance of a function from zero, of a rounded one from the nearest whole number. */
  height(k, zero) {
    return Math.abs(this.own.rounded[k] ? zero - Math.round(zero) : zero);
  }

  /** The functions whose change of sign is an event: the zero functions; of a rounded one both edges. */
  roots() {
    const { own, scene } = this;
    const sides = own.zeroTargets.map((register) => (this.w[register] > 0 ? 1 : -1));
    const rounded = [...own.zeros.keys()].filter((k) => own.rounded[k]);
    const signs = [...sides.map((s, k) => (own.rounded[k] ? 1 : s)), ...rounded.map(() => 1)];
    const level = own.zeroTargets.map((register) => this.w[register]);
    const value = (t, x) => {
      scene.evaluate(scene.functions.look, t, x);
      const zero = own.zeros.map((register) => scene.w[register]);
      const margin = Float64Array.from(this.margin);
      const found = zero.map((v, k) => (own.rounded[k] ? v - level[k] + margin[k] : v + sides[k] * margin[k]));
      zero.forEach((v, k) => {
        if (this.height(k, v) > 100 * margin[k]) this.margin[k] = 0; // it has left zero, whatever comes
        if (Math.abs(v) > this.largest[k]) this.largest[k] = Math.abs(v);
      });
      return Float64Array.from([...found, ...rounded.map((k) => level[k] + 1 - zero[k] + margin[k])]);
    };
    return { signs, value };
  }
}
