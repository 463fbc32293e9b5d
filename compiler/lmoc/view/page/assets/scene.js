// A scene in the page: its registers, the functions that fill them, and the start of a run.

import { makeBlocks, putSolutions, solutionsOf } from "./blocks.js";
import { curveAt } from "./curve.js";
import { HybridDynamics } from "./hybrid_dynamics.js";

const LOOKS = 4001; // points at which a switch that is not linear in time is looked at
const MET = 1e-6; // of the size of a start value: by how much it may be missed
const BISECTIONS = 60;
const SHORTEST = 1 / 64; // part of the way between two places at which a block is solved

const numbers = (list) => Float64Array.from(list, (v) => (v === null ? NaN : v));

/**
 * A scene ready to be simulated.
 *
 * `data` is what the compiler has written; `make(tab, blocks)` returns its functions of (w, time).
 */
export class Scene {
  constructor(data, make) {
    this.data = data;
    this.blocks = makeBlocks(data.blocks);
    this.functions = make(data.tables, this.blocks);
    this.w = numbers(data.base);
    this.dynamics = null;
    const others = (data.choices ?? []).map((own, k) => new Scene(own, this.functions.choices[k]));
    this.choices = others.length ? [this, ...others] : []; // of coordinates, where the run has changed them
    this.seed();
  }

  seed() {
    this.last = this.kept = null;
    this.blocks.memory.fill(null);
    this.blocks.changes++;
    for (const [register, value] of this.data.seeds) this.w[register] = value;
  }

  sample(time) {
    for (const curve of this.data.curves) this.w[curve.register] = curveAt(curve, time);
  }

  /** Fill every register for a time and the states `x`. */
  observe(time, x) {
    this.evaluate(this.functions.observe, time, x);
    return this.w;
  }

  rates(time, x, out) {
    const { derivatives } = this.data;
    this.evaluate(this.functions.rhs, time, x);
    for (let j = 0; j < derivatives.length; j++) out[j] = this.w[derivatives[j]];
  }

  /** Run a function at a place; where a block loses its solution, on the way there from the last place in short steps. */
  evaluate(run, time, x) {
    if (this.attempt(run, time, x)) return;
    const { last } = this;
    if (last === null) return;
    putSolutions(this.blocks, last.solutions);
    for (let reached = 0, length = 0.5; reached < 1 && length >= SHORTEST; ) {
      const goal = Math.min(1, reached + length);
      const between = goal === 1 ? x : x.map((v, j) => (1 - goal) * last.x[j] + goal * v);
      if (this.attempt(run, goal === 1 ? time : (1 - goal) * last.time + goal * time, between)) {
        reached = goal;
        length *= 2;
      } else length /= 2;
    }
  }

  attempt(run, time, x) {
    const { w, blocks } = this;
    const { states } = this.data;
    const before = this.data.seeds.length ? solutionsOf(blocks) : null;
    for (let j = 0; j < states.length; j++) w[states[j]] = x[j];
    this.sample(time);
    blocks.failed = false;
    run(w, time);
    if (before === null) return true;
    if (blocks.failed) putSolutions(blocks, before);
    const now = solutionsOf(blocks);
    const solved = now.some((solution, k) => solution !== before[k]); // some functions solve none: those stand elsewhere
    if (!blocks.failed && solved) this.last = { time, x: Float64Array.from(x), solutions: now };
    return !blocks.failed;
  }

  /** Remember where the blocks have been solved last, to return there with `restore`. */
  keep() {
    this.kept = this.last;
  }

  restore() {
    if (this.kept === null) return;
    this.last = this.kept;
    putSolutions(this.blocks, this.kept.solutions);
  }

  /** Why the parameter values of the last start are none that the model allows; "" where they are. */
  refused() {
    const broken = this.data.checks.find(([register]) => this.w[register] === 0);
    if (broken !== undefined) return broken[1];
    if (this.missed === undefined) return "";
    return `the start value of ${this.missed[2]} contradicts others, and the page does not compute their compromise`;
  }

  /** Take parameter values, [[slot, value], …]. */
  put(changed) {
    const { w, data } = this;
    w.set(numbers(data.base));
    this.seed();
    for (const [slot, value] of changed) w[slot] = value;
    this.functions.parameters(w, NaN);
  }

  /** Whether this choice of coordinates has these flat variables for its states. */
  hasStates(variables) {
    const { rows, variable } = this.data.watch;
    const own = variable.slice(rows);
    return own.length === variables.length && variables.every((v) => own.includes(v));
  }

  /** The states of another choice where this one stands at {t, x}; its nonlinear blocks begin there. */
  passTo(other, passage, t, x) {
    const w = this.observe(t, x);
    other.seed();
    for (const [there, here] of passage) other.w[there] = here < 0 ? NaN : w[here];
    const states = Float64Array.from(other.data.states, (register) => other.w[register]);
    other.blocks.patient = true;
    other.observe(t, states);
    other.blocks.patient = false;
    return states;
  }

  /** The states at the start for parameter values `changed`, [[slot, value], …], where `initial`, {state: value}, is given. */
  start(changed, initial = {}) {
    const { data, functions, w, blocks } = this;
    this.put(changed);
    for (const other of this.choices.slice(1)) {
      const slots = new Map(other.data.slots);
      other.put(changed.flatMap(([slot, value]) => (slots.get(slot) >= 0 ? [[slots.get(slot), value]] : [])));
    }
    this.dynamics = null;
    this.missed = undefined;
    if (this.refused() !== "") return new Float64Array(0);
    const states = () => {
      data.states.forEach((register, j) => (w[register] = data.x[j]));
      this.sample(data.begin);
      blocks.patient = true;
      functions.start(w, data.begin);
      const x = Float64Array.from(data.states, (register, j) => initial[data.names[j]] ?? w[register]);
      this.observe(data.begin, x);
      blocks.patient = false;
      if (Object.keys(initial).length) return x;
      this.missed = data.met.find(([is, wanted]) => Math.abs(w[is] - w[wanted]) > MET * Math.max(1, Math.abs(w[wanted])));
      return x;
    };
    if (data.laws === null && data.events === null) return states();
    this.dynamics = new HybridDynamics(this);
    const x = this.dynamics.start(states);
    this.observe(data.begin, x);
    return x;
  }

  /** Times between two at which formulas of time or tables have kinks, in order. */
  breaks(begin, end) {
    const { data, w } = this;
    const found = [...data.breakTimes];
    this.functions.breaks(w, begin);
    for (const [slope, offset] of data.lines) found.push(-w[offset] / w[slope]);
    found.push(...this.crossings(begin, end));
    const margin = 1e-12 * Math.max(Math.abs(begin), Math.abs(end));
    const inside = found.filter((t) => t >= begin && t <= end - margin).sort((a, b) => a - b);
    return inside.filter((t, k) => k === 0 || t - inside[k - 1] > margin);
  }

  /** Places at which the switches that are not linear in time change, by bisection. */
  crossings(begin, end) {
    const { data, w, functions } = this;
    const found = [];
    if (data.switches.length === 0) return found;
    const levels = (t) => {
      functions.breaks(w, t);
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
