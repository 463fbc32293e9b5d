// A run in the page: start, integrate from kink to kink, observe.

import { makeBlocks, putSolutions, signsOf, solutionsOf, turned } from "./blocks.js";
import { curveAt } from "./curve.js";
import { Dop853 } from "./dop853.js";

const LOOKS = 4001; // points at which a switch that is not linear in time is looked at
const BISECTIONS = 60;
const SHORTEST = 1 / 64; // part of the way between two places at which a block is solved
const CLOCK = 16; // steps between two looks at the clock

const numbers = (list) => Float64Array.from(list, (v) => (v === null ? NaN : v));

/** Some units of the last digit of a time, by which the stages of a step may be off. */
const near = (t) => 4e-15 * Math.max(Math.abs(t), 1e-300);

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
    this.seed();
  }

  seed() {
    this.last = this.kept = null;
    this.blocks.memory.fill(null);
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
    else this.last = { time, x: Float64Array.from(x), solutions: solutionsOf(blocks) };
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
    return broken === undefined ? "" : broken[1];
  }

  /** The states at the start for parameter values `changed`, [[slot, value], …]. */
  start(changed) {
    const { data, functions, w, blocks } = this;
    w.set(numbers(data.base));
    this.seed();
    for (const [slot, value] of changed) w[slot] = value;
    functions.parameters(w, NaN);
    data.states.forEach((register, j) => (w[register] = data.x[j]));
    this.sample(data.begin);
    blocks.patient = true;
    functions.start(w, data.begin);
    const x = Float64Array.from(data.states, (register) => w[register]);
    this.observe(data.begin, x);
    blocks.patient = false;
    return x;
  }

  /** Times at which formulas of time or tables have kinks, in order. */
  breaks() {
    const { data, w } = this;
    const { begin, end } = data;
    const found = [...data.breakTimes];
    this.functions.breaks(w, begin);
    for (const [slope, offset] of data.lines) found.push(-w[offset] / w[slope]);
    found.push(...this.crossings());
    const margin = 1e-12 * Math.max(Math.abs(begin), Math.abs(end));
    const inside = found.filter((t) => t >= begin && t <= end - margin).sort((a, b) => a - b);
    return inside.filter((t, k) => k === 0 || t - inside[k - 1] > margin);
  }

  /** Places at which the switches that are not linear in time change, by bisection. */
  crossings() {
    const { data, w, functions } = this;
    const found = [];
    if (data.switches.length === 0) return found;
    const levels = (t) => {
      functions.breaks(w, t);
      return data.switches.map(([register, jumps]) => (jumps ? w[register] : w[register] > 0));
    };
    let before = levels(data.begin);
    let past = data.begin;
    for (let k = 1; k < LOOKS; k++) {
      const t = data.begin + ((data.end - data.begin) * k) / (LOOKS - 1);
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

/**
 * Simulate for parameter values `changed`, [[slot, value], …].
 *
 * Returns {time, columns, complete, reason, steps, evaluations}: the values of the registers `wanted` at those of the
 * `times` that were reached.
 */
export function simulate(scene, changed, times, wanted, limits = {}) {
  const { deadline = Infinity, now = () => 0, mostSteps = 200000 } = limits;
  const run = {
    time: times,
    columns: wanted.map(() => new Float64Array(times.length).fill(NaN)),
    reached: 0,
    complete: false,
    reason: "",
    steps: 0,
    evaluations: 0,
  };
  const { data } = scene;
  const x = scene.start(changed);
  const signs = signsOf(scene.blocks);
  const place = new Float64Array(x.length);
  const record = (time, state) => {
    const w = scene.observe(time, state);
    for (let c = 0; c < wanted.length; c++) run.columns[c][run.reached] = w[wanted[c]];
    run.reached++;
  };
  run.reason = scene.refused();
  if (run.reason !== "") return { ...run, time: [], columns: wanted.map(() => new Float64Array(0)) };
  if (x.some((v) => !Number.isFinite(v))) run.reason = "there is no start with these values";
  else if (x.length === 0) for (const t of times) record(t, x);
  else integrate();
  run.complete = run.reason === "" && run.reached === times.length;
  run.time = times.slice(0, run.reached);
  run.columns = run.columns.map((column) => column.subarray(0, run.reached));
  return run;

  function integrate() {
    const edges = [...edgesOf(scene), Infinity];
    let begin = data.begin;
    for (const edge of edges) {
      if (edge - near(edge) / 2 <= begin) {
        if (edge !== Infinity) begin = Math.max(begin, edge + near(edge) / 2);
        continue;
      }
      const end = Math.min(data.end, edge === Infinity ? data.end : edge - near(edge) / 2);
      if (begin >= end) break;
      if (!piece(begin, end, Math.min(edge + near(edge), data.end))) return;
      begin = edge + near(edge) / 2;
    }
    while (run.reached < times.length && times[run.reached] <= data.end) record(times[run.reached], x);
  }

  /** Integrate where nothing jumps; output times up to `until` belong to it. */
  function piece(begin, end, until) {
    const most = scene.longest(begin, end);
    const { rtol, atol } = data;
    let method = new Dop853(data.method, scene, begin, x, end, { rtol, atol, maxStep: most });
    let trying = data.refine !== null;
    const outputs = () => {
      while (run.reached < times.length && Math.min(Math.max(times[run.reached], begin), end) <= method.t) {
        const time = times[run.reached];
        if (time > until) return;
        if (method.steps === 0) place.set(method.x);
        else method.interpolate(Math.min(Math.max(time, begin), end), place);
        record(time, place);
      }
    };
    /** Go on with tolerances such that the errors of all steps together keep the one that was asked for. */
    const refine = () => {
      const factor = refinement(data.refine, (method.t - begin) / Math.max(1, method.steps), end - begin);
      const finer = { rtol: rtol * factor, atol: atol.map((a) => a * factor), maxStep: most, firstStep: method.stepSize };
      count(run, method);
      x.set(method.x);
      method = new Dop853(data.method, scene, method.t, x, end, finer);
    };
    outputs();
    while (method.t < end && run.reason === "") {
      if (trying && method.steps + method.rejected >= data.refine.trial) {
        trying = false;
        refine();
      }
      if (!method.step(times[run.reached])) run.reason = `the run stops at t = ${method.t.toPrecision(6)} s: it has no values beyond`;
      else if (turned(signs, signsOf(scene.blocks), data.watched)) {
        run.reason = `the coordinates would have to change at t = ${method.t.toPrecision(4)} s`;
      } else outputs();
      if (method.steps % CLOCK === 0 && now() > deadline) run.reason = "it takes too long";
      if (run.steps + method.steps + method.rejected > mostSteps) run.reason = "it takes too many steps";
    }
    x.set(method.x);
    count(run, method);
    return run.reason === "";
  }
}

/** The factor on the tolerance of steps of a mean length, such that a run as a whole keeps the tolerance. */
export function refinement({ added, worthwhile, least, forgotten, slowest }, mean, length) {
  const memory = slowest > 0 ? Math.max(mean, Math.min(length, forgotten / slowest)) : length;
  const factor = Math.max(least, Math.min(1, (added * mean) / memory));
  return factor < worthwhile ? factor : 1;
}

function count(run, method) {
  run.steps += method.steps;
  run.evaluations += method.evaluations;
}

/** Kinks, and where other bounds on the steps begin. */
function edgesOf(scene) {
  const edges = scene.data.bounds.slice(1).map(([edge]) => edge);
  return [...scene.breaks(), ...edges].sort((a, b) => a - b);
}
