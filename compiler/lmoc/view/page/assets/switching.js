// The laws of one run on its way: the mode that holds, the functions whose roots end it, and what happens there, as
// `numerics/laws/switching.py`.

import { Contradiction, ContactKinematics } from "./instant.js";
import { filled, indices } from "./matrix.js";
import { freeMode, STILL } from "./mode.js";
import { ofDrift, project } from "./manifold.js";
import { heldVelocities } from "./rest.js";
import { Stopped } from "./stopped.js";
import { transition } from "./transition.js";

const KEPT = 1e-14; // share of its terms by which what is closed may miss zero at output times
const UP_TO_ROUNDING = 1e-10; // values below this share of their terms are zero at the beginning of a piece …
const APART = 1e-13; // … and have come back to zero only when they are below zero by this share …
const LEAVING = 1e-16; // … or by this one where they grow from zero at once
const COARSER = 10; // times these shares behind each root at which nothing has happened
const OVERLAP = 1e-8; // a gap is negative where it is by this share of the lengths of the scene …
const OVERLAP_ROUNDING = 1e-12; // … and by more than what start values may be wrong by that are differences

export class LawSwitching {
  constructor(scene) {
    this.scene = scene;
    this.kinematics = new ContactKinematics(scene);
    const { count } = this.kinematics;
    this.count = count;
    this.mode = freeMode(count);
    this.now = null; // where the present piece begins
    this.touched = filled(count, false); // laws whose motion was zero there
    this.idle = filled(count, 0); // roots in sequence at which nothing has happened to a law
    this.second = []; // the laws whose forces have a lower limit as well
    this.still = null; // velocities that the closed laws keep at zero
  }

  /** Have the equations hold in the present mode. */
  hold() {
    this.kinematics.hold(this.mode, this.still);
  }

  /** The functions that are positive as long as the mode holds: one a law, two for stuck friction. */
  roots(t, x) {
    const { scene, mode } = this;
    const { own, table } = this.kinematics;
    this.second = this.stuckFriction();
    const value = (time, state) => {
      scene.evaluate(scene.functions.lawRoots, time, state);
      const { w } = scene;
      const force = (k) => w[own.force[k]];
      const limit = (k) => w[own.stick[k]] * (table.normal[k] < 0 ? 1 : force(table.normal[k]));
      const first = own.force.map((_, k) => {
        if (table.complementary[k]) {
          if (mode.closed[k]) return force(k);
          if (mode.implied[k]) return 1; // others hold it at rest, up to rounding
          return w[own.gap[k] < 0 ? own.rate[k] : own.gap[k]];
        }
        if (mode.closed[k]) return limit(k) - force(k);
        return mode.implied[k] ? 1 : mode.direction[k] * w[own.rate[k]];
      });
      return Float64Array.from([...first, ...this.second.map((k) => limit(k) + force(k))]);
    };
    const apart = this.apart(value(t, x));
    return { signs: filled(apart.length, 1), value: (time, state) => value(time, state).map((v, k) => v + apart[k]) };
  }

  stuckFriction() {
    return indices(this.mode.closed.map((c, k) => c && !this.kinematics.table.complementary[k]));
  }

  /** What keeps functions that begin at zero, up to rounding, from being noticed at once. */
  apart(value) {
    const { now, mode, idle, touched } = this;
    const { table } = this.kinematics;
    const finite = (v) => (Number.isFinite(v) ? v : 0);
    return value.map((v, row) => {
      const k = row < this.count ? row : this.second[row - this.count];
      const coarser = COARSER ** idle[k];
      const leaves = table.unilateral[k] && !mode.closed[k] && now.rate[k] > STILL * now.rateScale[k];
      const held = Math.abs(now.bias[k] / now.delassus[k][k]) + finite(now.stick[k]);
      const scale = mode.closed[k] ? finite(held) : table.unilateral[k] ? now.gapScale[k] : now.rateScale[k];
      const concerned = mode.closed[k] || touched[k] || idle[k] > 0;
      const driven = this.kinematics.own.curvedGaps[k] && touched[k] && !mode.closed[k];
      const drifted = driven ? ofDrift(this.kinematics, [now.gapSlope[k]])[0] : 0;
      if (!concerned || !(Math.abs(v) <= Math.max(UP_TO_ROUNDING * coarser * scale, drifted))) return 0;
      return Math.max(-v, 0) + (leaves && idle[k] === 0 ? LEAVING : APART * coarser) * scale;
    });
  }

  /** Closed laws whose gaps, and whose rates, the integrator keeps at zero within its errors alone: two masks. */
  drifting() {
    const { own, table } = this.kinematics;
    const { closed } = this.mode;
    const gaps = closed.map((c, k) => c && own.curvedGaps[k] && table.unilateral[k] && table.degree[k] >= 1);
    return [gaps, closed.map((c, k) => c && own.curvedRates[k] && table.degree[k] === 2)];
  }

  /**
   * A state moved onto what is closed: the same array where it is there, NaN where there is no way.
   *
   * `share` of the terms of a gap, or of a rate, is by how much it may miss zero.
   */
  kept(t, x, share = KEPT) {
    const [gaps, rates] = this.drifting();
    const now = this.kinematics.at(t, x);
    const near = (chosen, values, scale) => indices(chosen).every((k) => Math.abs(values[k]) <= share * scale[k]);
    try {
      if (near(gaps, now.gap, now.gapScale) && near(rates, now.rate, now.rateScale)) return x;
      return project(this.kinematics, now, gaps, rates).x;
    } catch (failed) {
      if (!(failed instanceof Contradiction)) throw failed;
      return new Float64Array(x.length).fill(NaN);
    } finally {
      this.hold();
    }
  }

  /** The state at the start, on what is closed there, and what happened on the way: [x, events]. */
  start(t, x) {
    const none = filled(this.count, false);
    return this.take(t, x, { closing: none, opening: none, direction: filled(this.count, 0), jumped: false }, true);
  }

  /**
   * The state behind an instant at which root functions vanish, and what happened: [x, events].
   *
   * `jumped`: the states have been changed from outside.
   */
  happen(t, x, which, jumped = false) {
    const { closed } = this.mode;
    const first = closed.map((_, k) => Boolean(which[k]));
    const second = filled(this.count, false);
    this.second.forEach((k, i) => (second[k] = Boolean(which[this.count + i])));
    const trigger = {
      closing: first.map((f, k) => f && !closed[k]),
      opening: first.map((f, k) => (f || second[k]) && closed[k]),
      direction: first.map((f) => (f ? -1 : 1)), // a force at its upper limit gives way to a motion against it
      jumped,
    };
    const [state, events] = this.take(t, x, trigger, false);
    const quiet = events.length === 0;
    this.idle = this.idle.map((idle, k) => {
      if ((first[k] || second[k]) && closed[k] === this.mode.closed[k] && quiet) return idle + 1;
      return quiet ? idle : 0;
    });
    return [state, events];
  }

  /** {law: what its mode is called} */
  words() {
    const { labels, closedWords, openWords } = this.kinematics.own;
    return Object.fromEntries(labels.map((name, k) => [name, (this.mode.closed[k] ? closedWords : openWords)[k]]));
  }

  /** The names of the parts whose root functions have vanished. */
  names(which) {
    const rows = [...this.mode.closed.keys(), ...this.second].filter((_, i) => which[i]);
    return [...new Set(rows.map((k) => this.kinematics.own.names[k]))].join(", ");
  }

  take(t, x, trigger, atStart) {
    const before = this.mode;
    const { own } = this.kinematics;
    const forms = this.kinematics.rateForms(); // first: they are evaluated elsewhere than the motion is
    const here = this.kinematics.at(t, x);
    this.refuseOverlaps(here, trigger);
    let found;
    try {
      found = transition(this.kinematics, here, before, trigger);
    } catch (failed) {
      if (!(failed instanceof Contradiction)) throw failed;
      const names = [...new Set(failed.laws.map((k) => own.names[k]))].join(", ");
      throw new Stopped(`the laws of ${names} contradict each other at t = ${t.toPrecision(6)} s: ${failed.message}`);
    }
    Object.assign(this, { mode: found.mode, now: found.now, touched: found.touched });
    const closedForms = forms.filter((form, k) => form !== null && found.mode.closed[k]);
    this.still = heldVelocities(closedForms, own.held.length);
    const state = Float64Array.from(found.now.x, (v, j) => (this.still[j] ? 0 : v));
    if (own.work >= 0 && found.impulse.some((v) => v !== 0)) {
      const lost = found.lost.reduce((sum, v) => sum + v, 0);
      state[own.heat] += lost;
      state[own.work] += lost + found.now.stored - found.before.stored;
    }
    this.hold();
    return [state, this.events(t, before, found, atStart)];
  }

  /** Stop where a gap is negative that no motion has closed: start values or a jump have put it there. */
  refuseOverlaps(now, trigger) {
    const { table, own } = this.kinematics;
    const { mode } = this;
    const concerned = indices(table.unilateral.map((u, k) => u && table.degree[k] >= 1));
    const allowed = OVERLAP * Math.max(0, ...concerned.map((k) => now.gapScale[k])) + OVERLAP_ROUNDING;
    const wrong = concerned.find((k) => !mode.closed[k] && !trigger.closing[k] && now.gap[k] < -allowed);
    if (wrong === undefined) return;
    const gap = now.gap[wrong].toPrecision(6);
    throw new Stopped(`the gap of '${own.names[wrong]}' is negative, ${gap}, at t = ${now.t.toPrecision(6)} s`);
  }

  events(t, before, found, atStart) {
    const { own } = this.kinematics;
    const events = [];
    const passing = (k) => before.closed[k] && found.mode.closed[k] && !found.accumulated[k];
    const alone = found.impulse.every((v, k) => v === 0 || passing(k)); // nobody else has been hit: they are the impact
    own.names.forEach((name, k) => {
      const was = before.closed[k];
      const now = found.mode.closed[k];
      const impulse = found.impulse[k];
      let kind = now ? own.closing[k] : own.opening[k];
      if (found.accumulated[k]) kind = "accumulation";
      else if (was === now && before.direction[k] * found.mode.direction[k] >= 0) {
        if (impulse === 0 || (was && !alone)) return;
        kind = "impact";
      } else if (atStart && impulse === 0) return; // how it begins is no event
      const time = found.accumulated[k] ? Math.max(t, found.until) : t;
      const word = (closed) => (closed ? own.closedWords[k] : own.openWords[k]);
      const note = impulse === 0 ? "" : `${found.impactLaw}'s law`;
      events.push({ time, name, kind, before: word(was), after: word(now), impulse, energy_lost: found.lost[k], note });
    });
    return events;
  }
}
