// Radau IIA of order 5 for stiff equations, with dense output of order 3.
//
// Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.8: simplified Newton's method on transformed stages,
// one real and one complex system, here of twice the size in real numbers. The matrix comes from differences.

import { factorize, substitute } from "./linear.js";

const S6 = 6 ** 0.5;
const RADAU_NODES = [(4 - S6) / 10, (4 + S6) / 10, 1];
const ERROR = [(-13 - 7 * S6) / 3, (-13 + 7 * S6) / 3, -1 / 3];
const REAL = 3 + 3 ** (2 / 3) - 3 ** (1 / 3); // eigenvalues of the inverse of the method's matrix
const COMPLEX = [3 + 0.5 * (3 ** (1 / 3) - 3 ** (2 / 3)), -0.5 * (3 ** (5 / 6) + 3 ** (7 / 6))];
const BACK = [
  [0.09443876248897524, -0.14125529502095421, 0.03002919410514742],
  [0.25021312296533332, 0.20412935229379994, -0.38294211275726192],
  [1, 1, 0],
];
const TRANSFORM = [
  [4.17871859155190428, 0.32768282076106237, 0.52337644549944951],
  [-4.17871859155190428, -0.32768282076106237, 0.47662355450055044],
  [0.50287263494578682, -2.57192694985560522, 0.59603920482822492],
];
const DENSE = [
  [13 / 3 + (7 * S6) / 3, -23 / 3 - (22 * S6) / 3, 10 / 3 + 5 * S6],
  [13 / 3 - (7 * S6) / 3, -23 / 3 + (22 * S6) / 3, 10 / 3 - 5 * S6],
  [1 / 3, -8 / 3, 10 / 3],
];
const MOST_ITERATIONS = 6;
const LEAST_FACTOR = 0.2;
const MOST_FACTOR = 10;

/** An integration under way; the interface of `Dop853`. */
export class Radau {
  constructor(system, t, x, end, { rtol, atol, maxStep = Infinity, firstStep }) {
    Object.assign(this, { system, t, end, rtol, atol, maxStep, stepSize: firstStep, before: t, n: x.length });
    this.x = Float64Array.from(x);
    this.last = Float64Array.from(x);
    this.f = new Float64Array(this.n);
    this.steps = this.rejected = this.evaluations = 0;
    this.tolerance = Math.max(2.2e-15 / rtol, Math.min(0.03, rtol ** 0.5));
    this.dense = null;
    this.earlier = null; // step size and error of the step before
    this.rates(t, this.x, this.f);
    this.renew();
  }

  /** Go on from another state at the same time. */
  jump(x) {
    this.before = this.t;
    this.x.set(x);
    this.last.set(x);
    this.dense = this.earlier = null;
    this.rates(this.t, this.x, this.f);
    this.renew();
  }

  rates(t, x, out) {
    this.system.rates(t, x, out);
    this.evaluations++;
  }

  /** Take the Jacobian at the present place. */
  renew() {
    const { n, x, t, f } = this;
    this.jacobian = new Float64Array(n * n);
    const aside = Float64Array.from(x);
    const there = new Float64Array(n);
    for (let j = 0; j < n; j++) {
      const change = 1.5e-8 * Math.max(Math.abs(x[j]), this.atol[j] / this.rtol);
      aside[j] = x[j] + change;
      this.rates(t, aside, there);
      for (let i = 0; i < n; i++) this.jacobian[i * n + j] = (there[i] - f[i]) / (aside[j] - x[j]);
      aside[j] = x[j];
    }
    this.rates(t, x, there);
    this.system.programs.mark();
    this.factors = null;
    this.fresh = true;
  }

  factorized(h) {
    if (this.factors !== null && this.factors.h === h) return this.factors;
    const { n, jacobian } = this;
    const real = jacobian.map((v, k) => (k % (n + 1) === 0 ? REAL / h : 0) - v);
    const both = new Float64Array(4 * n * n);
    const [a, b] = [COMPLEX[0] / h, COMPLEX[1] / h];
    for (let i = 0; i < n; i++) {
      for (let j = 0; j < n; j++) {
        const own = (i === j ? a : 0) - jacobian[i * n + j];
        both[2 * n * i + j] = both[2 * n * (i + n) + j + n] = own;
      }
      both[2 * n * i + i + n] = -b;
      both[2 * n * (i + n) + i] = b;
    }
    const pivots = [new Int32Array(n), new Int32Array(2 * n)];
    const regular = factorize(real, n, pivots[0]) !== 0 && factorize(both, 2 * n, pivots[1]) !== 0;
    this.factors = { h, real, both, pivots, regular };
    return this.factors;
  }

  norm(v, scale) {
    let sum = 0;
    for (let i = 0; i < this.n; i++) sum += (v[i] / scale[i]) ** 2;
    return Math.sqrt(sum / this.n);
  }

  /** One step; false where none can be made. */
  step() {
    const { n, x, t, end } = this;
    let h = Math.min(this.stepSize, this.maxStep, end - t);
    if (t + 1.001 * h >= end) h = end - t;
    for (;;) {
      if (!(h > 1e-15 * Math.max(Math.abs(t), 1e-300))) return false;
      this.system.programs.goBack();
      const scale = x.map((v, i) => this.atol[i] + this.rtol * Math.abs(v));
      const found = this.stages(h, scale);
      if (found === null) {
        this.rejected++;
        if (this.fresh) h /= 2;
        else this.renew();
        continue;
      }
      const { z, iterations, rate } = found;
      const next = x.map((v, i) => v + z[2][i]);
      const size = next.map((v, i) => this.atol[i] + this.rtol * Math.max(Math.abs(v), Math.abs(x[i])));
      let error = this.error(h, z, this.f);
      let far = this.norm(error, size);
      const safety = (0.9 * (2 * MOST_ITERATIONS + 1)) / (2 * MOST_ITERATIONS + iterations);
      if (far > 1 && this.rejectedLast) {
        const beside = new Float64Array(n);
        this.rates(t, x.map((v, i) => v + error[i]), beside);
        error = this.error(h, z, beside);
        far = this.norm(error, size);
      }
      if (!(far <= 1)) {
        this.rejected++;
        this.rejectedLast = true;
        h *= Number.isFinite(far) ? Math.max(LEAST_FACTOR, safety * this.factor(h, far)) : 0.1;
        continue;
      }
      this.accept(h, z, next, far, safety, iterations > 2 && rate > 1e-3);
      return true;
    }
  }

  /** Simplified Newton's method: {z, iterations, rate}; null where it does not converge. */
  stages(h, scale) {
    const { n, x, t } = this;
    const { real, both, pivots, regular } = this.factorized(h);
    if (!regular) return null;
    const z = RADAU_NODES.map((c) => (this.dense === null ? new Float64Array(n) : this.continued(t + h * c)));
    const w = TRANSFORM.map((row) => z[0].map((_, i) => row[0] * z[0][i] + row[1] * z[1][i] + row[2] * z[2][i]));
    const f = [0, 1, 2].map(() => new Float64Array(n));
    let before = null;
    let rate = null;
    for (let k = 0; k < MOST_ITERATIONS; k++) {
      for (let s = 0; s < 3; s++) this.rates(t + h * RADAU_NODES[s], x.map((v, i) => v + z[s][i]), f[s]);
      if (!f.every((v) => v.every(Number.isFinite))) return null;
      const own = TRANSFORM.map((row) => f[0].map((_, i) => row[0] * f[0][i] + row[1] * f[1][i] + row[2] * f[2][i]));
      const first = own[0].map((v, i) => v - (REAL / h) * w[0][i]);
      const second = new Float64Array(2 * n);
      for (let i = 0; i < n; i++) {
        second[i] = own[1][i] - (COMPLEX[0] * w[1][i] - COMPLEX[1] * w[2][i]) / h;
        second[i + n] = own[2][i] - (COMPLEX[0] * w[2][i] + COMPLEX[1] * w[1][i]) / h;
      }
      substitute(real, n, pivots[0], first);
      substitute(both, 2 * n, pivots[1], second);
      let sum = 0;
      for (let i = 0; i < n; i++) sum += (first[i] ** 2 + second[i] ** 2 + second[i + n] ** 2) / scale[i] ** 2;
      const length = Math.sqrt(sum / (3 * n));
      if (before !== null) {
        rate = length / before;
        if (rate >= 1 || (rate ** (MOST_ITERATIONS - k) / (1 - rate)) * length > this.tolerance) return null;
      }
      for (let i = 0; i < n; i++) {
        w[0][i] += first[i];
        w[1][i] += second[i];
        w[2][i] += second[i + n];
        for (let s = 0; s < 3; s++) z[s][i] = BACK[s][0] * w[0][i] + BACK[s][1] * w[1][i] + BACK[s][2] * w[2][i];
      }
      if (length === 0 || (rate !== null && (rate / (1 - rate)) * length < this.tolerance)) {
        return { z, iterations: k + 1, rate: rate ?? 0 };
      }
      before = length;
    }
    return null;
  }

  /** The increments that the polynomial of the last step gives for the next one. */
  continued(time) {
    const found = new Float64Array(this.n);
    this.interpolate(time, found);
    return found.map((v, i) => v - this.x[i]);
  }

  error(h, z, f) {
    const { real, pivots } = this.factors;
    const found = f.map((v, i) => v + (ERROR[0] * z[0][i] + ERROR[1] * z[1][i] + ERROR[2] * z[2][i]) / h);
    substitute(real, this.n, pivots[0], found);
    return found;
  }

  /** The factor of the step size that the error asks for (Gustafsson's predictive controller). */
  factor(h, error) {
    const multiplier = this.earlier === null || error === 0 ? 1 : (h / this.earlier.h) * (this.earlier.error / error) ** 0.25;
    return error === 0 ? MOST_FACTOR : Math.min(1, multiplier) * error ** -0.25;
  }

  accept(h, z, next, error, safety, slowly) {
    const factor = Math.min(MOST_FACTOR, safety * this.factor(h, error));
    this.system.programs.mark();
    this.steps++;
    this.last.set(this.x);
    this.x.set(next);
    Object.assign(this, { before: this.t, t: this.t + 1.001 * h >= this.end ? this.end : this.t + h, length: h });
    this.dense = DENSE[0].map((_, k) => z[0].map((_, i) => DENSE[0][k] * z[0][i] + DENSE[1][k] * z[1][i] + DENSE[2][k] * z[2][i]));
    this.earlier = { h, error };
    this.rejectedLast = false;
    this.rates(this.t, this.x, this.f);
    this.fresh = false;
    if (slowly) this.renew();
    this.stepSize = slowly || factor >= 1.2 ? h * factor : h; // else the factorized matrix serves again
  }

  /** Write the state at a time within the last step. */
  interpolate(time, out) {
    const theta = (time - this.before) / this.length;
    for (let i = 0; i < this.n; i++) {
      out[i] = this.last[i] + theta * (this.dense[0][i] + theta * (this.dense[1][i] + theta * this.dense[2][i]));
    }
  }
}
