// The laws of one run on its way, which the engine keeps (`engine/c/page_laws.c`): here its events get their names and its
// refusals their words, as `numerics/laws/switching.py`.

import { Stopped } from "./stopped.js";

const KEPT = 1e-14; // share of its terms by which what is closed may miss zero at output times
const MOMENT = 1e-10; // share of the run within which laws that change without end are chattering
const FIELDS = ["closed", "implied", "direction", "push", "kind", "when", "impulse", "lost", "was", "is", "wrong", "gap", "impactLaw"];
const REVERSAL = "reversal"; // friction that slips on, the other way, opens nothing
const [, ACCUMULATION, IMPACT] = [0, 1, 2]; // kinds of `engine/c/law_run.h`; the others are what laws themselves call it
const IMPACT_LAWS = ["Newton", "Poisson"];
const REASONS = { 1: "no forces keep them", 3: "no states nearby satisfy them", 4: "no impulses keep them" };
const [OVERLAPS, GAP_JUMPS, CHATTERS, NO_END] = [5, 6, 7, 8];

export class LawSwitching {
  constructor(scene) {
    const { programs, data } = scene;
    Object.assign(this, { scene, programs, own: data.laws, exports: programs.exports, page: programs.page });
    this.count = this.own.names.length;
    this.open();
  }

  /** Have the equations hold with all laws open. */
  open() {
    this.exports.lmoc_page_open(this.page);
  }

  /** A number of each law. */
  all(name) {
    const which = FIELDS.indexOf(name);
    return this.own.names.map((_, k) => this.exports.lmoc_page_law(this.page, k, which));
  }

  /** Take what the integrator has allowed itself in a step. */
  allow(errors) {
    new Float64Array(this.programs.buffer, this.exports.lmoc_page_errors(this.page), errors.length).set(errors);
  }

  /** Whether anything is closed that the integrator keeps so within its errors alone. */
  get drifts() {
    return this.exports.lmoc_page_laws_drift(this.page) !== 0;
  }

  /**
   * A state moved onto what is closed: the same array where it is there, NaN where there is no way.
   *
   * `share` of the terms of a gap, or of a rate, is by how much it may miss zero.
   */
  kept(t, x, share = KEPT) {
    this.programs.x.set(x);
    const found = this.programs.checkedStatus(this.exports.lmoc_page_keep(this.page, t, share));
    if (found !== 0) return new Float64Array(x.length).fill(NaN);
    return this.moved(x);
  }

  moved(x) {
    const { answer } = this.programs;
    return answer.every((v, j) => v === x[j]) ? x : Float64Array.from(answer);
  }

  /** Take the values of parameters; all laws are open then. */
  begin() {
    const { begin, end } = this.scene.data;
    this.exports.lmoc_page_begin_laws(this.page, MOMENT * (end - begin));
  }

  /** The state at the start, on what is closed there, and what happened on the way: [x, events]. */
  start(t, x) {
    this.begin();
    this.programs.x.set(x);
    return this.take(t, this.exports.lmoc_page_start_laws(this.page, t));
  }

  /** The state behind an instant at which something else has changed, and what happened: [x, events]. */
  happen(t, x) {
    this.programs.x.set(x);
    return this.take(t, this.exports.lmoc_page_laws_happen(this.page, t));
  }

  take(t, status) {
    this.judge(t, status);
    return [Float64Array.from(this.programs.answer), this.events()];
  }

  judge(t, status) {
    const found = this.programs.checkedStatus(status);
    if (found !== 0) throw new Stopped(this.reason(found, t));
  }

  reason(found, t) {
    const wrong = this.all("wrong");
    const rows = [...wrong.keys()].filter((k) => wrong[k]);
    const names = [...new Set(rows.map((k) => this.own.names[k]))].join(", ");
    const at = `at t = ${t.toPrecision(6)} s`;
    if (found === OVERLAPS) return `the gap of '${names}' is negative, ${this.all("gap")[rows[0]].toPrecision(6)}, ${at}`;
    if (found === GAP_JUMPS) return `the gap of '${names}', which is closed, jumps to ${this.all("gap")[rows[0]].toPrecision(6)} ${at}`;
    if (found === NO_END) return `laws and events change each other again and again ${at}`;
    if (found === CHATTERS) return `the laws of ${names} open and close without end ${at}`;
    return `the laws of ${names} contradict each other ${at}: ${REASONS[found] ?? "there is no way on"}`;
  }

  /** {law: what its mode is called} */
  words() {
    const { labels, closedWords, openWords } = this.own;
    const closed = this.all("closed");
    return Object.fromEntries(labels.map((name, k) => [name, (closed[k] ? closedWords : openWords)[k]]));
  }

  events() {
    const { own } = this;
    const [kind, when, impulse, lost, was, is, impactLaw] = ["kind", "when", "impulse", "lost", "was", "is", "impactLaw"].map((name) => this.all(name));
    return own.names.flatMap((name, k) => {
      if (!kind[k]) return [];
      const word = (closed) => (closed ? own.closedWords[k] : own.openWords[k]);
      const called = { [ACCUMULATION]: "accumulation", [IMPACT]: "impact" }[kind[k]] ?? (is[k] ? own.closing[k] : was[k] ? own.opening[k] : REVERSAL);
      const note = impulse[k] === 0 ? "" : `${IMPACT_LAWS[impactLaw[k]]}'s law`;
      const what = { before: word(was[k]), after: word(is[k]), impulse: impulse[k], energy_lost: lost[k], note };
      return [{ time: when[k], name, kind: called, ...what }];
    });
  }
}
