// The events and laws of a run, combined, as `numerics/events/hybrid_dynamics.py`: at an instant the laws go first, then the
// discrete equations, and the laws again where those have changed something that they depend on.

import { EventHandler } from "./event_handler.js";
import { located } from "./discrete_state.js";
import { LawSwitching } from "./switching.js";

export class HybridDynamics {
  constructor(scene) {
    this.scene = scene;
    const { data } = scene;
    this.laws = data.laws === null ? null : new LawSwitching(scene);
    this.handler = data.events === null ? null : new EventHandler(scene);
    this.records = [];
    this.modes = []; // [since, {law: mode}]
    this.lawRoots = 0;
    this.reached = data.begin; // s, of the latest instant
  }

  get until() {
    return this.handler === null ? this.scene.data.end : this.handler.until;
  }

  get longestStep() {
    return this.handler === null ? Infinity : this.handler.longestStep;
  }

  /** What moves states onto what is closed, (t, x, share) → x (`LawSwitching.kept`); null where it stays closed by itself. */
  get kept() {
    const { laws } = this;
    if (laws === null || !laws.drifts) return null;
    return (t, x, share) => laws.kept(t, x, share);
  }

  /** What ends the piece that begins at a place; null where nothing does. */
  roots(t, x) {
    const roots = this.scene.programs.roots(t, x);
    if (this.laws !== null) this.noteMode(t);
    this.lawRoots = roots?.laws ?? 0;
    return roots;
  }

  /** Remember the mode that holds from a time on; at one instant the last counts. */
  noteMode(t) {
    const words = this.laws.words();
    if (this.modes.length && this.modes.at(-1)[0] === t) this.modes.pop();
    const before = this.modes.at(-1)?.[1] ?? {};
    if (Object.entries(words).some(([law, mode]) => before[law] !== mode)) this.modes.push([t, words]);
  }

  /** The states at the start, behind what happens there. `states()` finds the states of the model. */
  start(states) {
    const { begin } = this.scene.data;
    let x = this.handler === null ? states() : this.handler.start(states);
    this.collect();
    if (this.laws === null) return x;
    const [state, events] = this.laws.start(begin, x);
    this.records.push(...events);
    x = state;
    if (this.handler === null) return x;
    this.leave(x);
    return this.settle(begin, x);
  }

  /**
   * What has ended a piece, {t, x, which}, with all that follows it more closely than the places of roots are known: whether
   * a state reaches a level an ulp before the tick of a clock, or behind it, is rounding.
   */
  together({ t: ended, x, which }, roots) {
    const { begin } = this.scene.data;
    const t = this.handler === null || which === null ? ended : this.handler.instant(ended, located(ended, begin));
    if (roots === null || x.length === 0 || !(t > this.reached)) return { t, x, which };
    const [rates, ahead] = [new Float64Array(x.length), located(t, begin)];
    this.scene.rates(t, x, rates);
    const now = roots.value(t, x);
    const then = roots.value(t + ahead, x.map((v, j) => v + ahead * rates[j]));
    const soon = roots.signs.map((s, k) => !which?.[k] && s * then[k] < 0 && s * then[k] < s * now[k]);
    return { t, x, which: soon.some(Boolean) ? soon.map((s, k) => s || Boolean(which?.[k])) : which };
  }

  /** The states behind what has ended a piece at {t, x, which}; null at the end of the run. */
  after({ t, x, which }) {
    const { rtol, atol } = this.scene.data;
    if (this.laws !== null) this.laws.allow(x.map((v, j) => rtol * Math.abs(v) + atol[j]));
    this.reached = t;
    const ofLaws = which === null ? [] : [...which].slice(0, this.lawRoots);
    let state = x;
    if (ofLaws.some(Boolean)) {
      const [behind, events] = this.laws.happen(t, x, ofLaws);
      this.records.push(...events);
      state = behind;
    }
    if (this.handler === null) return which === null ? null : state;
    if (this.laws !== null) this.leave(state);
    const behind = this.handler.after(t, state, which === null ? null : [...which].slice(this.lawRoots));
    this.collect();
    return behind === null || this.laws === null ? behind : this.settle(t, behind);
  }

  /** Laws have left the states so, with the discrete values before an event. */
  leave(x) {
    const { programs } = this.scene;
    programs.x.set(x);
    programs.exports.lmoc_page_left(programs.page);
  }

  /** Let laws and discrete equations answer each other until nothing changes, from states. */
  settle(t, x) {
    const { programs } = this.scene;
    Object.assign(programs, { dynamics: this });
    this.instant = t;
    programs.x.set(x);
    this.laws.judge(t, programs.exports.lmoc_page_settle(programs.page, t));
    return Float64Array.from(programs.answer);
  }

  tellLaws() {
    this.records.push(...this.laws.events());
  }

  tellEvent(found) {
    this.handler.happened(this.instant, "when", found);
    this.collect();
  }

  collect() {
    if (this.handler === null) return;
    this.records.push(...this.handler.records);
    this.handler.records = [];
  }
}
