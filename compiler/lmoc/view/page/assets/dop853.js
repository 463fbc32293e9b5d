// DOP853: an explicit Runge–Kutta method of order 8 with dense output of order 7.
//
// Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.4 to II.6. The coefficients are those of
// the compiler's own integrator, {a, b, c, d, e3, e5}: the page carries them beside the scene.

import { Stopped } from "./stopped.js";

const SAFETY = 0.9;
const SHRINK = 0.2;
const GROW = 8;
const ROUGH = [5.5, 60]; // |h·λ| and roughness, in tolerances, from which the dense output is not good enough
const CAREFUL = 4.5; // |h·λ| up to which it is, and which the steps keep to …
const CAREFUL_STEPS = 50; // … for so many steps after one was found too rough
const STIFF_LIMIT = 6.1; // |h·λ| at the edge of the stability region
const STIFF_STEPS = 15; // limited by it, after which …
const MOST_AHEAD = 5000; // … so many steps ahead are too many
const LAST_WEIGHT = (4 / 7) ** 4 * (3 / 7) ** 3; // of the last term of the polynomial where it is largest

/** Σ weights[i]·k[i][j], zero weights left out. */
function combine(weights, k, j) {
  let sum = 0;
  for (let i = 0; i < weights.length; i++) if (weights[i] !== 0) sum += weights[i] * k[i][j];
  return sum;
}

/** An integration under way: `t`, `x` stand at the end of the last step, which began at `before`. */
export class Dop853 {
  /**
   * `system` has `rates(t, x, out)`, which writes the derivatives; what it remembers from one call to the next is kept
   * by `keep()` where a step ends, and `restore()` is called before each try. `atol` is one number for each component. Without a `firstStep` one is found.
   */
  constructor(table, system, t, x, end, { rtol, atol, maxStep = Infinity, firstStep = null }) {
    Object.assign(this, { table, system, t, end, rtol, atol, maxStep, n: x.length, before: t });
    this.x = Float64Array.from(x);
    this.last = Float64Array.from(x); // where the last step began
    this.k = Array.from({ length: 16 }, () => new Float64Array(this.n));
    this.f = new Float64Array(this.n);
    this.trial = new Float64Array(this.n);
    this.steps = this.rejected = 0;
    this.evaluations = 1;
    this.length = 0;
    this.grow = GROW;
    this.careful = this.stiffCount = this.calmCount = 0;
    this.isStiff = false; // whether too many steps lie ahead that stability limits
    this.terms = null;
    system.rates(t, this.x, this.f);
    system.keep();
    this.stepSize = firstStep ?? this.findFirstStep();
  }

  /** Go on from another state at the same time. */
  jump(x) {
    this.before = this.t;
    this.x.set(x);
    this.last.set(x);
    this.system.rates(this.t, this.x, this.f);
    this.system.keep();
    this.evaluations++;
  }

  norm(v) {
    let sum = 0;
    for (let j = 0; j < this.n; j++) sum += (v[j] / (this.atol[j] + this.rtol * Math.abs(this.x[j]))) ** 2;
    return Math.sqrt(sum / this.n);
  }

  findFirstStep() {
    const span = this.end - this.t;
    const d0 = this.norm(this.x);
    const d1 = this.norm(this.f);
    const h0 = Math.min(d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : (0.01 * d0) / d1, span, this.maxStep);
    for (let j = 0; j < this.n; j++) this.trial[j] = this.x[j] + h0 * this.f[j];
    const slope = new Float64Array(this.n);
    this.system.rates(this.t + h0, this.trial, slope);
    this.evaluations++;
    for (let j = 0; j < this.n; j++) slope[j] -= this.f[j];
    const d2 = this.norm(slope) / h0;
    if (!Number.isFinite(d2)) return h0 * 1e-3;
    const steepest = Math.max(d1, d2);
    const h1 = steepest <= 1e-15 ? Math.max(1e-6, h0 * 1e-3) : (0.01 / steepest) ** (1 / 8);
    return Math.min(100 * h0, h1, span);
  }

  /**
   * Make one step; false where none can be made: the derivatives are no numbers, or the steps become too short.
   *
   * `wanted` is the next output time: where it lies within the step, its dense output must be good.
   */
  step(wanted = Infinity) {
    let h = Math.min(this.stepSize, this.maxStep);
    for (;;) {
      const last = this.t + 1.001 * h >= this.end;
      const next = last ? this.end : this.t + h;
      if (last) h = this.end - this.t;
      if (!(h > 8e-16 * Math.abs(next))) return false;
      const error = this.attempt(h);
      if (error < 1 && this.stiffness >= ROUGH[0] && wanted < next && this.roughness(h) > ROUGH[1]) {
        this.rejected++;
        this.careful = CAREFUL_STEPS;
        h *= CAREFUL / this.stiffness;
        continue;
      }
      if (error < 1) {
        this.accept(next, h, error);
        return true;
      }
      this.rejected++;
      h *= Number.isFinite(error) ? Math.max(SHRINK, SAFETY * error ** -0.125) : 0.1;
      this.grow = 1;
    }
  }

  attempt(h) {
    const { table, k, n, x, t, trial } = this;
    this.system.restore();
    k[0].set(this.f);
    for (let i = 1; i < 12; i++) this.stage(i, h, x, t);
    for (let j = 0; j < n; j++) trial[j] = x[j] + h * combine(table.b, k, j);
    this.system.rates(t + h, trial, k[12]);
    this.evaluations += 12;
    let e5 = 0;
    let e3 = 0;
    let change = 0;
    let rise = 0;
    for (let j = 0; j < n; j++) {
      const scale = this.atol[j] + this.rtol * Math.max(Math.abs(x[j]), Math.abs(trial[j]));
      e5 += (combine(table.e5, k, j) / scale) ** 2;
      e3 += (combine(table.e3, k, j) / scale) ** 2;
      change += (trial[j] - this.place[j]) ** 2;
      rise += (k[12][j] - k[11][j]) ** 2;
    }
    this.stiffness = change > 0 ? h * Math.sqrt(rise / change) : 0; // an estimate of |h·λ|
    return k[12].every(Number.isFinite) ? (h * e5) / Math.sqrt((e5 + 0.01 * e3 + 1e-300) * n) : NaN;
  }

  stage(i, h, x, t) {
    const { table, k, n } = this;
    const place = (this.place ??= new Float64Array(n));
    for (let j = 0; j < n; j++) place[j] = x[j] + h * combine(table.a[i], k, j);
    this.system.rates(t + table.c[i] * h, place, k[i]);
  }

  /** Size of the last term of the dense output of the step just tried, in tolerances. */
  roughness(h) {
    const { table, k, n, x } = this;
    for (let i = 13; i < 16; i++) this.stage(i, h, x, this.t);
    let sum = 0;
    for (let j = 0; j < n; j++) {
      sum += ((LAST_WEIGHT * combine(table.d[3], k, j)) / (this.atol[j] + this.rtol * Math.abs(x[j]))) ** 2;
    }
    return h * Math.sqrt(sum / n);
  }

  accept(next, h, error) {
    this.system.keep();
    this.steps++;
    this.careful = Math.max(0, this.careful - 1);
    this.last.set(this.x);
    this.x.set(this.trial);
    this.f.set(this.k[12]);
    Object.assign(this, { before: this.t, t: next, length: h, terms: null });
    const factor = error > 0 ? Math.min(this.grow, Math.max(SHRINK, SAFETY * error ** -0.125)) : this.grow;
    const held = this.careful > 0 && factor * this.stiffness > CAREFUL;
    if (held || this.stiffness > STIFF_LIMIT) {
      this.calmCount = 0;
      this.isStiff = ++this.stiffCount >= STIFF_STEPS && (this.end - next) / h > MOST_AHEAD;
    } else if (++this.calmCount >= 6) this.stiffCount = 0;
    this.grow = GROW;
    this.stepSize = h * (held ? CAREFUL / this.stiffness : factor);
  }

  /** The terms of the polynomials within the last step. */
  dense() {
    if (this.terms !== null) return this.terms;
    const { table, k, n, last, length: h } = this;
    for (let i = 13; i < 16; i++) this.stage(i, h, last, this.before);
    this.evaluations += 3;
    this.terms = Array.from({ length: 7 }, () => new Float64Array(n));
    for (let j = 0; j < n; j++) {
      const rise = this.x[j] - last[j];
      this.terms[0][j] = rise;
      this.terms[1][j] = h * k[0][j] - rise;
      this.terms[2][j] = 2 * rise - h * (k[12][j] + k[0][j]);
      for (let i = 0; i < 4; i++) this.terms[3 + i][j] = h * combine(table.d[i], k, j);
    }
    if (!this.terms.every((term) => term.every(Number.isFinite))) {
      throw new Stopped(`the run stops at t = ${this.before.toPrecision(6)} s: it has no values beyond`);
    }
    return this.terms;
  }

  /** Write the state at a time within the last step. */
  interpolate(time, out) {
    const terms = this.dense();
    const theta = (time - this.before) / this.length;
    for (let j = 0; j < this.n; j++) {
      let y = terms[6][j] * theta;
      for (let i = 5; i >= 0; i--) y = (y + terms[i][j]) * (i % 2 ? 1 - theta : theta);
      out[j] = y + this.last[j];
    }
  }
}
