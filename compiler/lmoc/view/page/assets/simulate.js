// A run in the page: start, integrate from kink to kink and from event to event, observe.

import { Watch } from "./coordinates.js";
import { nearTo } from "./event_handler.js";
import { Steps } from "./steps.js";
import { Stopped } from "./stopped.js";

const CLOCK = 16; // steps between two looks at the clock
const SAME = 1e-14; // of the time: an output time that is that of an event
const FINER = 0.1; // factor on the tolerances of watched pieces behind the first, where one divides by what the other has found
const STIFFER = 0.1; // factor on the tolerances of the implicit method
const DRIFT = 0.1; // of the tolerance: from there on the states are moved onto what is closed
const LOOKS_WITHIN = 32; // places on a passage at which it is looked whether something happens; even, so that none is singular
const NO_TIME = 1e-15; // of the time: in a shorter piece nothing moves

/**
 * Simulate for parameter values `changed`, [[slot, value], …].
 *
 * Returns {time, columns, complete, reason, events, modes, steps, evaluations}: the values of the registers `wanted` at
 * those of the `times` that were reached.
 */
export function simulate(scene, changed, times, wanted, limits = {}) {
  return new Run(scene, times, wanted, limits).go(changed);
}

/**
 * A run; `pulls` are [t, [[register, value], …]], from when on signals of the hand have which values, `finer` is a factor on
 * the tolerances.
 */
export class Run {
  constructor(scene, times, wanted, { deadline = Infinity, now = () => 0, mostSteps = 1_000_000, initial = {}, pulls = [], finer = 1 }) {
    Object.assign(this, { scene, times, wanted, deadline, now, mostSteps, initial, pulls, finer, pulled: 0, horizon: Infinity, watch: null, lastWatch: null, begun: false, later: 1, lacking: false, short: null, busy: false, stalled: [0, null], tried: new Set() });
    this.registers = [wanted]; // of each choice of coordinates
    for (const other of scene.choices.slice(1)) {
      const observed = new Map(other.data.observed);
      this.registers.push(wanted.map((register) => observed.get(register) ?? -1));
    }
    Object.assign(this, { main: scene, choice: 0 });
    this.columns = wanted.map(() => new Float64Array(times.length).fill(NaN));
    this.reached = this.steps = this.evaluations = 0;
    this.reason = "";
  }

  go(changed) {
    for (const _ of this.stretches(changed));
    return this.result();
  }

  /** Run, and wait wherever the `horizon` has been reached. */
  *stretches(changed) {
    const { scene } = this;
    this.ended = false;
    try {
      const x = scene.start(changed, this.initial);
      this.reason = scene.refused();
      if (this.reason === "" && x.some((v) => !Number.isFinite(v))) this.reason = "there is no start with these values";
      if (this.reason === "") {
        scene.rates(scene.data.begin, x, new Float64Array(x.length));
        yield* this.pieces(x);
      }
    } catch (stopped) {
      if (!(stopped instanceof Stopped)) throw stopped;
      this.ended = !stopped.fails;
      this.reason = this.ended ? "" : stopped.message;
    }
  }

  result() {
    const { scene, ended, reached, reason, steps, evaluations } = this;
    const columns = this.columns.map((column) => column.subarray(0, reached));
    const complete = reason === "" && (ended || reached === this.times.length);
    const { records = [], modes = [], unbooked = Infinity } = scene.dynamics ?? {};
    return { time: this.times.slice(0, reached), columns, complete, reason, events: records, modes, unbooked, steps, evaluations };
  }

  record(time, x) {
    this.write(this.values(time, x));
  }

  /** What is wanted at a place. */
  values(time, x) {
    const w = this.scene.observe(time, x);
    return Float64Array.from(this.registers[this.choice], (register) => (register < 0 ? NaN : w[register]));
  }

  write(values) {
    values.forEach((v, c) => (this.columns[c][this.reached] = v));
    this.reached++;
  }

  /** Fill the registers of the first choice of coordinates at a place; what another one does not tell is NaN. */
  observed(t, x) {
    const { scene, main } = this;
    const w = scene.observe(t, x);
    if (scene === main) return w;
    const found = new Float64Array(main.w.length).fill(NaN);
    for (const [first, own] of scene.data.observed) found[first] = w[own];
    return found;
  }

  /** Give signals, [[register, value], …], values in all choices of coordinates. */
  put(signals) {
    const { main } = this;
    for (const [register, value] of signals) main.w[register] = value;
    for (const other of main.choices.slice(1)) {
      const own = new Map(other.data.observed);
      for (const [register, value] of signals) other.w[own.get(register)] = value;
    }
  }

  /** Give the signals of the hand the values that they have from a time on; the states behind that. */
  pull(t, x) {
    const { scene, pulls } = this;
    if (!(pulls[this.pulled]?.[0] <= t)) return x;
    for (; pulls[this.pulled]?.[0] <= t; this.pulled++) this.put(pulls[this.pulled][1]);
    const laws = scene.dynamics?.laws ?? null;
    if (laws === null) return x;
    const [behind, events] = laws.happen(t, x); // a force that jumps may close or open them
    scene.dynamics.records.push(...events);
    return behind;
  }

  /** Go from event to event. */
  *pieces(from) {
    const { times } = this;
    const { data } = this.scene;
    let x = from;
    let begin = data.begin;
    let serve = this.watched(begin, x);
    if (!serve && !this.watch.determines) this.reason = `the coordinates do not determine ${this.watch.lost} at the start`;
    for (;;) {
      const { dynamics } = this.scene;
      x = this.pull(begin, x);
      const until = dynamics?.until ?? data.end;
      const end = Math.min(until, this.horizon, this.pulls[this.pulled]?.[0] ?? Infinity);
      while (this.reached < times.length && times[this.reached] <= begin) this.record(times[this.reached], x);
      const roots = dynamics?.roots(begin, x) ?? null;
      const outcome = serve ? this.piece(begin, x, end, roots) : { t: begin, x, root: false, changes: true, stuck: false };
      serve = true;
      this.steps++; // a piece may end within its first step, again and again
      if (this.steps > this.mostSteps) this.reason = "it takes too many steps";
      if (this.now() > this.deadline) this.reason = "it takes too long";
      if (this.reason !== "") return;
      if (outcome.changes) {
        const onward = this.otherCoordinates(outcome, until);
        if (onward === null) return;
        ({ t: begin, x, serve } = onward);
        continue;
      }
      if (end < until && !outcome.root) {
        [begin, x] = [outcome.t, outcome.x];
        if (end === this.horizon) yield { t: begin, x };
        continue;
      }
      const { t, behind } = dynamics === null ? { t: outcome.t, behind: null } : dynamics.after(outcome);
      if (behind === null) {
        while (this.reached < times.length && times[this.reached] <= data.end) this.record(times[this.reached], outcome.x);
        return;
      }
      const last = times[this.reached - 1];
      if (this.reached && t >= last && t - last <= SAME * Math.abs(t)) {
        this.reached--; // the value at an event is the one behind it
        this.record(last, behind);
      }
      [begin, x] = [t, behind];
      serve = this.watched(begin, x);
    }
  }

  /** Watch the coordinates from a place on, where what they divide by changes along the motion; whether they serve there. */
  watched(t, x) {
    this.watch = this.scene.data.watch === null || x.length === 0 ? null : new Watch(this.scene, t, x, this.lastWatch);
    this.later = this.watch !== null && this.begun ? FINER : 1;
    this.begun = true;
    this.lastWatch = this.watch ?? this.lastWatch;
    return this.watch === null || this.watch.serves;
  }

  /** Go on from {t, x} in better coordinates, or behind a singular position: {t, x, serve}; null where there is no way. */
  otherCoordinates({ t, x, stuck }, until) {
    const { watch, scene } = this;
    watch.stand();
    this.stalled = [t === this.stalled[1] ? this.stalled[0] + 1 : 0, t];
    this.short = null;
    const onward = watch.lostRank ? this.beyond(t, x, until) : this.changed(t, x);
    if (onward !== null) return onward;
    const same = { t, x, serve: true };
    const worse = !stuck && !watch.passedSingular && !watch.lostRank;
    if (worse && !(watch.tolerate() && this.lacking)) return same;
    if (!worse) this.short = watch.shorter(this.stalled[0], scene.data.end - scene.data.begin);
    if (this.short?.longest > 0) return same;
    const { ahead, busy } = scene.data.watch;
    const others = "the coordinates would have to change, to some that this page does not have";
    const why = watch.lostRank ? (this.busy ? busy : ahead.replace("{lost}", watch.lost)) : others;
    this.reason = `the run stops at t = ${t.toPrecision(6)} s: ${why}`;
    return null;
  }

  /** Go on in better coordinates: {t, x, serve}; null where the page has none. */
  changed(t, x) {
    const { watch, main } = this;
    this.lacking = false;
    for (const variables of watch.better()) {
      const choice = main.choices.findIndex((other) => other.hasStates(variables));
      this.lacking ||= choice < 0;
      const key = `${t} ${choice}`;
      if (choice < 0 || this.tried.has(key)) continue; // it has begun here with them already
      this.tried.add(key);
      const other = main.choices[choice];
      const state = this.scene.passTo(other, main.data.passages[this.choice][choice], t, x);
      if (!state.every(Number.isFinite)) continue;
      other.dynamics = this.scene.dynamics?.adopted(other, t, state) ?? null;
      Object.assign(this, { scene: other, choice });
      return { t, x: state, serve: this.watched(t, state) };
    }
    return null;
  }

  /** Go on behind a place where the constraints depend on each other: {t, x, serve}; null where nothing leads there. */
  beyond(t, x, until) {
    const { watch, scene, times } = this;
    const { rtol, atol, begin, end, watch: own } = scene.data;
    const known = x.map((v, j) => Math.max(FINER * (rtol * Math.abs(v) + atol[j]), own.rounding * (own.sizes[j] ?? Math.max(1, Math.abs(v)))));
    const behind = watch.pass(known, end - begin);
    const busy = behind !== null && this.happens(t, behind, until);
    this.busy = busy || (this.busy && behind === null); // nearer, rounding may hide it
    if (behind === null || busy) {
      watch.stand();
      return null;
    }
    const reached = Math.min(behind, end);
    while (this.reached < times.length && (times[this.reached] < reached || reached === end)) {
      const found = new Float64Array(this.wanted.length);
      for (const [time, weight] of watch.beside(times[this.reached])) {
        this.values(time, watch.over(time)).forEach((v, c) => (found[c] += weight * v));
      }
      this.write(found);
    }
    const state = watch.over(reached);
    return { t: reached, x: state, serve: this.watched(reached, state) };
  }

  /** Whether a law or an event, or the hand, changes the motion on a passage (`HybridDynamics.happen_on`). */
  happens(t, behind, until) {
    const { dynamics } = this.scene;
    if (this.pulls[this.pulled]?.[0] <= behind) return true;
    if (dynamics === null) return false;
    if (behind >= until) return true;
    for (let k = 0; k < LOOKS_WITHIN; k++) {
      const time = t + ((behind - t) * k) / (LOOKS_WITHIN - 1);
      const state = this.watch.over(time);
      const roots = dynamics.roots(time, state);
      const values = roots?.value(time, state) ?? [];
      if (values.some((v, i) => !(v * roots.signs[i] >= 0))) return true;
    }
    return false;
  }

  /** Integrate to `end`, or to the first root before: {t, x, root}, and whether there was one. */
  piece(from, x, end, roots) {
    const { scene } = this;
    if (x.length === 0 && roots === null) {
      while (this.reached < this.times.length && this.times[this.reached] <= end) this.record(this.times[this.reached], x);
      return { t: end, x, root: false };
    }
    if (end - from <= NO_TIME * Math.max(Math.abs(from), Math.abs(end))) return { t: Math.max(from, end), x, root: false };
    const later = [...scene.data.bounds.slice(1).map(([edge]) => edge), this.short?.until ?? end];
    const edges = [...scene.breaks(from, end), ...later.filter((edge) => edge > from && edge < end)];
    if (scene.dynamics?.nextStep === end) edges.push(end); // no step looks at the other side of a jump
    let [begin, state] = [from, x];
    for (const edge of [...edges.sort((a, b) => a - b), Infinity]) {
      const margin = edge === Infinity ? 0 : nearTo(edge);
      if (edge - margin / 2 <= begin) {
        begin = Math.max(begin, edge + margin / 2);
        continue;
      }
      if (begin >= end) break;
      const outcome = this.smooth(begin, state, Math.min(end, edge - margin / 2), Math.min(edge + margin, end), roots);
      if (outcome.root || outcome.changes || this.reason !== "") return outcome;
      [begin, state] = [edge + margin / 2, outcome.x];
    }
    return { t: end, x: state, root: false };
  }

  /** Integrate where nothing jumps; output times up to `until` belong to it. */
  smooth(begin, x, end, until, roots) {
    const { scene, times } = this;
    const { data, dynamics } = scene;
    const finer = this.finer * this.later;
    const factor = finer * calibration(data.refine, data.rtol * finer);
    const longest = (begin + end) / 2 < this.short?.until ? this.short.longest : Infinity;
    const maxStep = Math.min(scene.longest(begin, end), dynamics?.longestStep ?? Infinity, longest);
    const place = new Float64Array(x.length);
    const kept = dynamics?.kept ?? null;
    let trying = data.refine !== null && x.length > 0;
    let method = new Steps(scene, begin, x, end, { ...this.tolerances(factor), maxStep });
    if (roots !== null) method.follow(begin, x);
    const outputs = (last) => {
      while (this.reached < times.length && times[this.reached] <= until) {
        const time = Math.min(Math.max(times[this.reached], begin), end);
        if (time > last) return;
        method.interpolate(time, place);
        this.record(times[this.reached], kept === null ? place : kept(time, place));
      }
    };
    outputs(begin);
    while (method.t < end) {
      if (trying && !method.isImplicit && method.steps + method.rejected >= data.refine.trial) {
        trying = false;
        method = this.refined(method, begin, end, maxStep, factor);
      }
      if (method.isStiff) method.stiffen(this.tolerances(factor * STIFFER));
      const wanted = roots === null ? (times[this.reached] ?? Infinity) : -Infinity;
      if (!method.step(wanted)) {
        if (this.watch?.stuck()) return this.stopped(method, method.t, method.x, true);
        this.reason = `the run stops at t = ${method.t.toPrecision(6)} s: it has no values beyond`;
      } else if (this.watch !== null && !this.watch.judge(method.t, method.x)) {
        return this.stopped(method, method.before, method.last, false);
      }
      if (this.reason !== "") break;
      const found = roots === null ? null : method.root();
      outputs(found === null ? method.t : found.t);
      if (found !== null) {
        this.count(method);
        return found;
      }
      if (kept !== null) this.correct(method, kept(method.t, method.x, DRIFT * data.rtol));
      this.judge(method);
    }
    this.count(method);
    return { t: end, x: Float64Array.from(method.x), root: false };
  }

  /** Go on from the state that has been found for the end of the last step. */
  correct(method, x) {
    if (x === method.x) return;
    if (x.every(Number.isFinite)) method.jump(x);
    else this.reason = `the run stops at t = ${method.t.toPrecision(6)} s: what is closed cannot stay closed`;
  }

  /** The end of a piece whose coordinates have become bad. */
  stopped(method, t, x, stuck) {
    this.count(method);
    return { t, x: Float64Array.from(x), root: false, changes: true, stuck };
  }

  judge(method) {
    if (method.steps % CLOCK === 0 && this.now() > this.deadline) this.reason = "it takes too long";
    if (this.steps + method.steps + method.rejected > this.mostSteps) this.reason = "it takes too many steps";
  }

  tolerances(factor) {
    const { rtol, atol } = this.scene.data;
    return { rtol: rtol * factor, atol: atol.map((a) => a * factor) };
  }

  /** Go on with tolerances such that the errors of all steps together keep the one that was asked for. */
  refined(method, begin, end, maxStep, coarse) {
    const { data } = this.scene;
    const factor = coarse * refinement(data.refine, (method.t - begin) / Math.max(1, method.steps), end - begin);
    this.count(method);
    return new Steps(this.scene, method.t, method.x, end, { ...this.tolerances(factor), maxStep, firstStep: method.stepSize });
  }

  count(method) {
    this.steps += method.steps;
    this.evaluations += method.evaluations;
  }
}

/** The factor on the tolerance with which the errors of few steps are as asked for. */
function calibration(refine, rtol) {
  return refine === null ? 1 : Math.max(refine.calibrated, Math.min(1, refine.noFiner / rtol));
}

/** The factor on the tolerance of steps of a mean length, such that a run as a whole keeps the tolerance. */
export function refinement({ added, power, worthwhile, least, forgotten, slowest }, mean, length) {
  const memory = slowest > 0 ? Math.max(mean, Math.min(length, forgotten / slowest)) : length;
  const factor = Math.max(least, Math.min(1, (added * mean) / memory) ** power);
  return factor < worthwhile ? factor : 1;
}
