// A scene in the page: its registers, the programs that fill them, and the start of a run.

import { HybridDynamics } from "./hybrid_dynamics.js";
import { Programs } from "./programs.js";

const LOOKS = 4001; // points at which a switch that is not linear in time is looked at
const MET = 1e-6; // of the size of a start value: by how much it may be missed
const BISECTIONS = 60;
const SHORTEST = 1 / 64; // part of the way to other parameters on which a start is solved

/** Registers from the values of those that have one at the beginning. */
function registersOf({ count, registers, values }) {
  const found = new Float64Array(count).fill(NaN);
  registers.forEach((register, k) => (found[register] = values[k]));
  return found;
}

/** Programs as functions of (time) that tell whether they were solved, and lists of such, by their names. */
function functionsOf(programs, places) {
  const one = (number) => Object.assign((time) => programs.run(number, time), { number });
  return Object.fromEntries(Object.entries(places).map(([name, own]) => [name, Array.isArray(own) ? own.map(one) : one(own)]));
}

/** A scene ready to be simulated: `data` is what the compiler has written, `engine` is compiled. */
export class Scene {
  constructor(data, engine) {
    this.data = data;
    this.programs = new Programs(engine, data.code, data.states.length);
    this.base = registersOf(data.base);
    this.w = this.programs.w.subarray(0, this.base.length);
    this.w.set(this.base);
    this.functions = functionsOf(this.programs, data.programs);
    this.dynamics = null;
    const others = (data.choices ?? []).map((own) => new Scene(own, engine));
    this.choices = others.length ? [this, ...others] : []; // of coordinates, where the run has changed them
    this.seed();
  }

  /** Let nonlinear blocks begin as in the run at hand. */
  seed() {
    for (const [register, value] of this.data.seeds) this.w[register] = value;
    this.programs.seed();
  }

  /** Fill every register for a time and the states `x`. */
  observe(time, x) {
    this.evaluate(this.functions.observe, time, x);
    return this.w;
  }

  rates(time, x, out) {
    this.programs.rates(time, x, out);
  }

  /** Run a function at a place; what it cannot solve has no value. */
  evaluate(run, time, x) {
    return this.programs.evaluate(run.number, time, x);
  }

  /** Why the parameter values of the last start are none that the model allows; "" where they are. */
  refused() {
    const broken = this.data.checks.find(([, registers]) => registers.some((register) => this.w[register] === 0));
    if (broken !== undefined) return broken[0];
    if (this.missed === undefined) return "";
    return `the start value of ${this.missed[2]} contradicts others, and the page does not compute their compromise`;
  }

  /** Take parameter values, [[slot, value], …]. */
  put(changed) {
    const { w, data } = this;
    w.set(this.base);
    this.seed();
    for (const [slot, value] of changed) w[slot] = value;
    this.programs.forget();
    this.functions.parameters(NaN);
  }

  /** Whether these flat variables are states in this choice of coordinates. */
  hasStates(variables) {
    return variables.every((v) => this.data.coordinates.includes(v));
  }

  /** The states of another choice where this one stands at {t, x}; its nonlinear blocks begin there. */
  passTo(other, passage, t, x) {
    const w = this.observe(t, x);
    other.seed();
    for (const [there, here] of passage) other.w[there] = here < 0 ? NaN : w[here];
    return Float64Array.from(other.data.states, (register) => other.w[register]);
  }

  /** The states at the start for parameter values `changed`, [[slot, value], …], where `initial`, {state: value}, is given. */
  start(changed, initial = {}) {
    const { data, w } = this;
    this.put(changed);
    for (const other of this.choices.slice(1)) {
      const slots = new Map(other.data.slots);
      other.put(changed.flatMap(([slot, value]) => (slots.get(slot) >= 0 ? [[slots.get(slot), value]] : [])));
    }
    this.dynamics = null;
    this.missed = undefined;
    if (this.refused() !== "") return new Float64Array(0);
    const states = () => {
      if (!this.solveStart(data.x)) this.approachStart(changed);
      const x = Float64Array.from(data.states, (register) => w[register]);
      this.observe(data.begin, x);
      const given = x.map((v, j) => initial[data.names[j]] ?? v);
      if (given.some((v, j) => v !== x[j])) {
        this.observe(data.begin, given); // loops are closed on the way there
        x.set(given);
      }
      if (Object.keys(initial).length) return x;
      this.missed = data.met.find(([is, wanted]) => Math.abs(w[is] - w[wanted]) > MET * Math.max(1, Math.abs(w[wanted])));
      return x;
    };
    if (data.laws === null && data.events === null && data.jumps === null) return states();
    this.dynamics = new HybridDynamics(this);
    const x = this.dynamics.start(states);
    this.observe(data.begin, x);
    return x;
  }

  /** Solve the equations of the start from states nearby; whether that has led to some. */
  solveStart(x) {
    this.data.states.forEach((register, j) => (this.w[register] = x[j]));
    this.programs.sample(this.data.begin);
    return this.functions.start(this.data.begin);
  }

  /** The start on the way from the model's own parameters, at which it is known. */
  approachStart(changed) {
    const { data, base, w, programs, functions } = this;
    const registers = [...data.states, ...data.seeds.map(([register]) => register)];
    let near = [...data.x, ...data.seeds.map(([, value]) => value)];
    for (let reached = 0, length = 0.5; reached < 1; ) {
      const goal = Math.min(1, reached + length);
      for (const [slot, value] of changed) w[slot] = base[slot] + goal * (value - base[slot]);
      registers.forEach((register, k) => (w[register] = near[k]));
      programs.forget();
      functions.parameters(NaN);
      if (this.solveStart(near.slice(0, data.states.length))) {
        near = registers.map((register) => w[register]);
        reached = goal;
        length *= 2;
      } else if ((length /= 2) < SHORTEST) return;
    }
  }

  /** Times between two at which formulas of time or tables have kinks, in order. */
  breaks(begin, end) {
    const margin = 1e-12 * Math.max(Math.abs(begin), Math.abs(end));
    const inside = [...this.data.breakTimes, ...this.kinks(begin, end)].filter((t) => t >= begin && t <= end - margin).sort((a, b) => a - b);
    return inside.filter((t, k) => k === 0 || t - inside[k - 1] > margin);
  }

  /** Times of the run at which inputs step or bend whose derivatives the equations hold. */
  stepTimes() {
    const { jumps, begin, end } = this.data;
    const margin = 1e-12 * Math.max(Math.abs(begin), Math.abs(end));
    const found = [...(jumps?.times ?? []), ...(jumps?.formulas ? this.kinks(begin, end) : [])];
    const inside = found.filter((t) => t >= begin - margin && t <= end + margin).map((t) => Math.min(Math.max(t, begin), end));
    const ordered = inside.sort((a, b) => a - b);
    return ordered.filter((t, k) => k === 0 || t - ordered[k - 1] > margin);
  }

  /** Places between two times at which formulas of time have kinks. */
  kinks(begin, end) {
    const { data, w } = this;
    const found = [];
    this.functions.breaks(begin);
    for (const [slope, offset] of data.lines) found.push(-w[offset] / w[slope]);
    found.push(...this.crossings(begin, end));
    return found;
  }

  /** Places at which the switches that are not linear in time change, by bisection. */
  crossings(begin, end) {
    const { data, w, functions } = this;
    const found = [];
    if (data.switches.length === 0) return found;
    const levels = (t) => {
      functions.breaks(t);
      return data.switches.map(([register, jumps]) => (jumps ? w[register] : w[register] > 0));
    };
    let before = levels(begin);
    let past = begin;
    for (let k = 1; k < LOOKS; k++) {
      const t = begin + ((end - begin) * k) / (LOOKS - 1);
      const here = levels(t);
      for (let i = 0; i < here.length; i++) {
        if (here[i] === before[i]) continue;
        let [low, high] = [past, t];
        for (let b = 0; b < BISECTIONS; b++) {
          const middle = (low + high) / 2;
          if (levels(middle)[i] === before[i]) low = middle;
          else high = middle;
        }
        found.push(high);
      }
      before = here;
      past = t;
    }
    return found;
  }

  /** The longest step allowed between two times. */
  longest(from, to) {
    const { bounds } = this.data;
    let most = Infinity;
    bounds.forEach(([edge, longest], k) => {
      const end = k + 1 < bounds.length ? bounds[k + 1][0] : Infinity;
      if (longest !== null && edge < to && end > from) most = Math.min(most, longest);
    });
    return most;
  }
}
