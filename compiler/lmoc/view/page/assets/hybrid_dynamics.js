// The events and laws of a run, combined, as `numerics/events/hybrid_dynamics.py`: at an instant the laws go first, then the
// discrete equations, and the laws again where those have changed something that they depend on.

import { EventHandler } from "./event_handler.js";
import { Stopped } from "./stopped.js";
import { LawSwitching } from "./switching.js";

const [OVER, STRUCK, NO_ANSWER] = [-2, -100, 1]; // as `engine/c/page.h` and `page_scene.h` have it

export class HybridDynamics {
  constructor(scene) {
    this.scene = scene;
    const { data } = scene;
    this.laws = data.laws === null ? null : new LawSwitching(scene);
    this.handler = data.events === null ? null : new EventHandler(scene);
    this.records = [];
    this.modes = []; // [since, {law: mode}]
    this.unbooked = Infinity; // s, from when on the ledger has no value
    const times = scene.stepTimes();
    const { exports, page, buffer } = scene.programs;
    const room = exports.lmoc_page_step_times(page, times.length, data.begin);
    scene.programs.checked(0);
    new Float64Array(buffer, room, times.length).set(times);
  }

  /** The same, which goes on in other coordinates of the scene from a place. */
  adopted(scene, t, x) {
    const { records, modes, unbooked } = this;
    const next = Object.assign(new HybridDynamics(scene), { records, modes, unbooked });
    const [from, to] = [this.scene.programs, scene.programs];
    const count = from.exports.lmoc_page_carried_count(from.page);
    const carried = ({ buffer, exports, page }) => new Float64Array(buffer, exports.lmoc_page_carried(page), count);
    next.laws?.begin();
    carried(to).set(carried(from));
    to.x.set(x);
    const found = to.checkedStatus(to.exports.lmoc_page_adopt(to.page, t));
    next.laws?.judge(t, found);
    return next;
  }

  get until() {
    return Math.min(this.handler === null ? this.scene.data.end : this.handler.until, this.nextStep);
  }

  /** s, at which inputs step next. */
  get nextStep() {
    return this.scene.programs.exports.lmoc_page_next_step(this.scene.programs.page);
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
    const { data, programs } = this.scene;
    const { begin } = data;
    Object.assign(programs, { dynamics: this });
    let x = this.handler === null ? states() : this.handler.start(states);
    this.collect();
    x = this.stepInputs(begin, x);
    if (this.laws === null) return x;
    const [state, events] = this.laws.start(begin, x);
    this.records.push(...events);
    x = state;
    if (this.handler === null) return x;
    this.leave(x);
    return this.settle(begin, x);
  }

  /** The states behind what has ended a piece, by a `root` or not, and when that was: {t, behind}, null at the end of the run. */
  after({ t: ended, x, root }) {
    const { data, programs } = this.scene;
    const { exports, page } = programs;
    if (this.laws !== null) this.laws.allow(x.map((v, j) => data.rtol * Math.abs(v) + data.atol[j]));
    Object.assign(programs, { dynamics: this });
    programs.x.set(x);
    const found = programs.checkedStatus(exports.lmoc_page_after(page, ended, data.begin, Number(root)));
    const t = exports.lmoc_page_instant(page);
    if (found === OVER) return { t, behind: null };
    this.laws?.judge(t, found);
    return { t, behind: Float64Array.from(programs.answer) };
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
    programs.x.set(x);
    this.laws.judge(t, programs.exports.lmoc_page_settle(programs.page, t));
    return Float64Array.from(programs.answer);
  }

  /** The states behind what inputs do at an instant. */
  stepInputs(t, x) {
    if (this.nextStep > t) return x;
    const { programs } = this.scene;
    programs.x.set(x);
    this.tellSteps(programs.exports.lmoc_page_input_steps(programs.page, t));
    return Float64Array.from(programs.answer);
  }

  /** Record what has stepped, and what it has come to. */
  tellSteps(found) {
    const { data, programs } = this.scene;
    const { exports, page } = programs;
    if (data.jumps === null) return;
    const [first, before, after, moved, unbooked] = [0, 1, 2, 3, 4].map((which) => exports.lmoc_page_stepped(page, which));
    const [name, t] = [data.jumps.names[first], exports.lmoc_page_instant(page)];
    const [was, is] = [before, after].map((v) => String(Number(v.toPrecision(6))));
    if (found === NO_ANSWER || (found !== 0 && Number.isNaN(before + after))) throw new Stopped(`the run stops at t = ${t.toPrecision(6)} s: the equations have no solution there`);
    if (found <= STRUCK) this.laws.judge(t, STRUCK - found);
    if (found < 0) throw new Stopped(`'${name}' jumps from ${was} to ${is} at t = ${t.toPrecision(6)} s, and ${data.jumps.reasons[-found]}`);
    if (unbooked) this.unbooked = Math.min(this.unbooked, t);
    if (moved) this.records.push({ time: t, name, kind: "step", before: was, after: is, impulse: 0, energy_lost: 0, note: "" });
  }

  tellLaws() {
    this.records.push(...this.laws.events());
  }

  tellEvent(found) {
    const { exports, page } = this.scene.programs;
    this.handler.happened(exports.lmoc_page_instant(page), found);
    this.collect();
  }

  collect() {
    if (this.handler === null) return;
    this.records.push(...this.handler.records);
    this.handler.records = [];
  }
}
