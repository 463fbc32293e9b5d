// The events of a run: when the next one comes, and its record, as `numerics/events/event_handler.py`. The engine carries them
// out (`engine/c/page_events.c`). All variables stand in the registers of the scene, the continuous ones as last looked at.

import { Stopped } from "./stopped.js";

const [SETTLED, NO_VALUE, , UNSETTLED] = [0, 1, 2, 3]; // what an instant comes to, as `engine/c/instant.h` has it
const CULPRIT = 100; // and more: which condition switches back and forth
const LEAST_LOOKS = 120; // steps at least in a run with relations of time that are not linear in it
const KINDS = ["when", "time", "terminal", "when"]; // as `engine/c/happen.h` has it

/** A distance in time that does not count: some units of the last digit. */
export const nearTo = (t) => 4e-15 * Math.max(Math.abs(t), 1e-300);

export class EventHandler {
  constructor(scene) {
    const { data, programs } = scene;
    const { exports, page } = programs;
    Object.assign(this, { scene, programs, exports, page, own: data.events, begin: data.begin, end: data.end });
    this.places = this.own.told.map(({ register }) => this.own.discrete.indexOf(register));
    this.records = [];
    for (const register of this.own.discrete) scene.w[register] = 0;
    scene.functions.discreteStarts(data.begin);
    exports.lmoc_page_begin_events(page, data.begin, data.end - data.begin);
  }

  /** States and discrete values that agree, behind what happens at the start. `states()` finds the states. */
  start(states) {
    const { programs, exports, page, begin } = this;
    programs.states = states;
    programs.equations = (first) => this.initialEquations(first);
    exports.lmoc_page_start_events(page, begin);
    programs.checked(0);
    return Float64Array.from(programs.answer);
  }

  initialEquations(first) {
    const { w, functions } = this.scene;
    this.own.initialEquations.forEach(({ waits, same }, k) => {
      if (first && waits) return;
      functions.initialEquations[k](this.begin);
      if (first) for (const [past, now] of same) w[now] = w[past];
    });
  }

  /** s, where the present piece ends at the latest. */
  get until() {
    return Math.min(this.exports.lmoc_page_happened(this.page, 0), this.end);
  }

  get longestStep() {
    return this.own.looksAtTime ? (this.end - this.begin) / LEAST_LOOKS : Infinity;
  }

  judge(found, t) {
    if (found === SETTLED) return;
    const at = `t = ${t.toPrecision(6)} s`;
    if (found >= CULPRIT) throw new Stopped(`'${this.own.texts[found - CULPRIT]}' switches back and forth at ${at}`);
    if (found === UNSETTLED) throw new Stopped(`no values satisfy all equations at ${at}`);
    if (found === NO_VALUE) throw new Stopped(`the run stops at ${at}: the equations have no solution there`);
    throw new Stopped(`what is given a new value by reinit at ${at} is no state, and follows from more than one`);
  }

  /** Tell of what the engine has carried out. */
  happened(t, found) {
    const { exports, page, own, programs } = this;
    if (found <= 0) this.scene.dynamics.tellSteps(found);
    this.judge(found, t);
    const before = new Float64Array(programs.buffer, exports.lmoc_page_before(page), own.discrete.length);
    const news = Array.from({ length: exports.lmoc_page_told_count(page) }, (_, k) => own.news[exports.lmoc_page_told_of(page, k)]);
    const [kind, lost] = [1, 2].map((which) => exports.lmoc_page_happened(page, which));
    this.tell(t, KINDS[kind], news.filter(({ when }) => when), before, lost);
    const broken = news.find(({ error }) => error);
    if (broken) throw new Stopped(`an assertion does not hold: ${broken.message} (t = ${t.toPrecision(6)} s)`);
    const end = news.find(({ ends }) => ends);
    if (end) throw new Stopped(end.message, false);
  }

  tell(t, kind, whens, before, loss) {
    const { own, scene } = this;
    let lost = loss;
    const add = (record) => this.records.push({ time: t, before: "", after: "", impulse: 0, energy_lost: 0, note: "", ...record });
    for (const { name, text } of whens) {
      add({ name, kind: kind === "terminal" ? "when" : kind, after: text, energy_lost: lost });
      lost = 0;
    }
    own.told.forEach(({ register, name, boolean, hidden }, k) => {
      const [past, now] = [before[this.places[k]], scene.w[register]];
      if (now === past || (!hidden && whens.length)) return;
      const shown = (value) => (boolean ? String(Boolean(value)) : String(Number(value.toPrecision(6))));
      add({ name, kind: hidden ? "relation" : "change", before: shown(past), after: shown(now) });
    });
  }
}
