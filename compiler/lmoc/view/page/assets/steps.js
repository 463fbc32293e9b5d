// Steps of a run, which the engine makes (`engine/c/page_steps.c`): by DOP853, or by Radau IIA where stability would limit it.

import { Stopped } from "./stopped.js";

const MOST_AHEAD = 5000; // steps that stability may limit
const STIFF = 4; // what a step returns where more of them lie ahead
const [TIME, BEFORE, NEXT_LENGTH, REJECTED, EVALUATIONS] = [0, 1, 2, 3, 4];

/** An integration under way: `t`, `x` stand at the end of the last step, which began at `before` from `last`. */
export class Steps {
  /** `atol` is one number for each component. Without a `firstStep` one is found. */
  constructor({ programs }, t, x, end, { rtol, atol, maxStep = Infinity, firstStep = 0 }) {
    Object.assign(this, { programs, steps: 0, isStiff: false, isImplicit: false });
    this.x = Float64Array.from(x);
    this.last = Float64Array.from(x);
    programs.x.set(x);
    programs.atol.set(atol);
    programs.exports.lmoc_page_begin(programs.page, t, end, rtol, maxStep, firstStep, MOST_AHEAD);
    this.look();
  }

  look() {
    const told = (which) => this.programs.exports.lmoc_page_told(this.programs.page, which);
    Object.assign(this, { t: told(TIME), before: told(BEFORE), stepSize: told(NEXT_LENGTH) });
    Object.assign(this, { rejected: told(REJECTED), evaluations: told(EVALUATIONS) });
  }

  /** Go on with the implicit method, where there are not too many states for it. */
  stiffen({ rtol, atol }) {
    const { programs } = this;
    programs.atol.set(atol);
    this.isStiff = false;
    this.isImplicit = programs.exports.lmoc_page_stiffen(programs.page, rtol) !== 0;
    this.look();
  }

  /** Go on from another state at the same time. */
  jump(x) {
    const { programs } = this;
    this.x.set(x);
    this.last.set(x);
    programs.x.set(x);
    programs.exports.lmoc_page_jump(programs.page);
    this.look();
  }

  /** Make one step, whose dense output is good at the time `wanted`; false where none can be made. */
  step(wanted = Infinity) {
    const { programs } = this;
    const begun = this.t;
    const found = programs.exports.lmoc_page_step(programs.page, wanted);
    programs.checked(0);
    this.look();
    if (!(this.t > begun)) return false;
    this.steps++;
    this.last.set(this.x);
    this.x.set(programs.x);
    this.isStiff = found === STIFF;
    return true;
  }

  /** Write the state at a time within the last step. */
  interpolate(time, out) {
    const { programs } = this;
    if (!programs.exports.lmoc_page_within(programs.page, time)) this.missing();
    out.set(programs.answer);
  }

  missing() {
    throw new Stopped(`the run stops at t = ${this.before.toPrecision(6)} s: it has no values beyond`);
  }

  /** Follow the functions of `Programs.roots` from a place on. */
  follow(t, x) {
    const { programs } = this;
    programs.x.set(x);
    programs.exports.lmoc_page_follow(programs.page, t);
  }

  /** Where in the last step the first of them changes its sign, {t, x, root}; null where none does. */
  root() {
    const { programs } = this;
    const t = programs.exports.lmoc_page_root(programs.page);
    programs.checked(0);
    if (Number.isNaN(t)) throw new Error("there is no memory to look for events");
    if (t === -Infinity) this.missing();
    if (t === Infinity) return null;
    return { t, x: Float64Array.from(programs.answer), root: true };
  }
}
