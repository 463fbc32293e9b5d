// Steps of DOP853, which the engine makes.

import { Stopped } from "./stopped.js";

const MOST_AHEAD = 5000; // steps that stability may limit
const STIFF = 4; // what a step returns where more of them lie ahead
const [TIME, BEFORE, LENGTH, NEXT_LENGTH, REJECTED, EVALUATIONS] = [0, 1, 2, 3, 4, 5];

/** An integration under way: `t`, `x` stand at the end of the last step, which began at `before` from `last`. */
export class Dop853 {
  /** `atol` is one number for each component. Without a `firstStep` one is found. */
  constructor(scene, t, x, end, { rtol, atol, maxStep = Infinity, firstStep = null }) {
    const { programs } = scene;
    Object.assign(this, { programs, t, end, steps: 0, isStiff: false });
    this.x = Float64Array.from(x);
    this.last = Float64Array.from(x);
    programs.x.set(x);
    programs.atol.set(atol);
    programs.exports.lmoc_page_begin(programs.page, t, end, rtol, maxStep, firstStep ?? 0, MOST_AHEAD);
    this.look();
  }

  look() {
    const told = (which) => this.programs.exports.lmoc_page_told(this.programs.page, which);
    Object.assign(this, { t: told(TIME), before: told(BEFORE), length: told(LENGTH), stepSize: told(NEXT_LENGTH) });
    Object.assign(this, { rejected: told(REJECTED), evaluations: told(EVALUATIONS) });
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
    const found = programs.exports.lmoc_page_step(programs.page, wanted ?? Infinity);
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
    if (time === this.t) out.set(this.x);
    else if (programs.exports.lmoc_page_within(programs.page, time)) out.set(programs.answer);
    else throw new Stopped(`the run stops at t = ${this.before.toPrecision(6)} s: it has no values beyond`);
  }
}
