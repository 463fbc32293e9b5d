// The discrete side of a run: values of discrete variables, and the iteration at an event, which the engine carries out
// (`engine/c/page_events.c`).
//
// All variables stand in the registers of the scene: the discrete ones, and the continuous ones as last looked at.

import { Stopped } from "./stopped.js";

const [SETTLED, NO_VALUE, , UNSETTLED] = [0, 1, 2, 3]; // what an instant comes to, as `engine/c/instant.h` has it
const CULPRIT = 100; // and more: which condition switches back and forth

/** A distance in time that does not count: some units of the last digit. */
export const nearTo = (t) => 4e-15 * Math.max(Math.abs(t), 1e-300);

export class DiscreteState {
  constructor(scene) {
    const { data, programs } = scene;
    Object.assign(this, { scene, programs, own: data.events, page: programs.page, exports: programs.exports });
    this.exports.lmoc_page_begin_events(this.page, data.begin, data.end - data.begin);
    for (const register of this.own.discrete) scene.w[register] = 0;
    scene.functions.discreteStarts(data.begin);
    this.remember();
  }

  get w() {
    return this.scene.w;
  }

  all() {
    return this.own.discrete.map((register) => this.w[register]);
  }

  /** Do something with a state; what the instant comes to. */
  ask(name, t, x, more = 0) {
    this.programs.x.set(x);
    const found = this.exports[`lmoc_page_${name}`](this.page, t, more);
    this.programs.checked(0);
    return found;
  }

  /** Take the continuous values at a place. */
  look(t, x) {
    this.judge(this.ask("take", t, x), t);
  }

  /** pre(v) := v */
  remember() {
    this.exports.lmoc_page_remember(this.page);
  }

  /** Carry out the discrete equations in their order. */
  assign() {
    this.exports.lmoc_page_assign(this.page);
  }

  /** Relations of time are taken as they are written, not as what they are right behind. */
  set literal(is) {
    this.exports.lmoc_page_literal(this.page, Number(is));
  }

  judge(found, t) {
    if (found === SETTLED) return;
    const at = `t = ${t.toPrecision(6)} s`;
    if (found >= CULPRIT) throw new Stopped(`'${this.own.texts[found - CULPRIT]}' switches back and forth at ${at}`);
    if (found === UNSETTLED) throw new Stopped(`no values satisfy all equations at ${at}`);
    if (found === NO_VALUE) throw new Stopped(`the run stops at ${at}: the equations have no solution there`);
    throw new Stopped(`what is given a new value by reinit at ${at} is no state, and follows from more than one`);
  }

  /**
   * What has been carried out at an instant, and booked: {x, before, told, kind, lost}, the states behind it, the discrete
   * values before it, the numbers of what is to be told, what it is called, and the energy that it has cost.
   */
  outcome(found, t) {
    const { exports, page, own, programs } = this;
    const what = found < 0 ? `'${own.jumping[-1 - found]}' jumps at t = ${t.toPrecision(6)} s` : "";
    if (what) throw new Stopped(`${what}, and the motion needs its derivative, which is an impulse there`);
    this.judge(found, t);
    const before = new Float64Array(programs.buffer, exports.lmoc_page_before(page), own.discrete.length);
    const told = Array.from({ length: exports.lmoc_page_told_count(page) }, (_, k) => exports.lmoc_page_told_of(page, k));
    const [kind, lost] = [1, 2].map((which) => exports.lmoc_page_happened(page, which));
    return { x: Float64Array.from(programs.answer), before, told, kind, lost };
  }

  /** The states with the values that `reinit` gives them; null where it gives none. */
  reinit(t, x) {
    const found = this.ask("reinit", t, x);
    if (found > 1) this.judge(found, t);
    return found ? Float64Array.from(this.programs.answer) : null;
  }

  /** The first time event behind a time, or, where asked for, at the time itself; infinity where there is none. */
  nextTime(t, include = false) {
    return this.exports.lmoc_page_next(this.page, t, Number(include));
  }

  /** s, of the next time event. */
  get next() {
    return this.exports.lmoc_page_happened(this.page, 0);
  }
}
