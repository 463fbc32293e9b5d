// Location of sign changes of functions of time and state within a step: on the step's own dense output, in order, as
// `engine/c/roots.c`, which cites the papers.

const INSIDE = [0, 0.25, 0.5, 0.75, 1]; // of a step, where the functions are looked at
const COARSE = 0.02; // of a function's change in a step: what samples may be off by that follow it
const MOST_SAMPLES = 500; // in a step
const TIGHTEST = 4e-16; // of the time: two places that close are one
const NEARER = [1e-2, 1e-4, 1e-6, 1e-9, 1e-12]; // shares of a bracket
const MOST_CALLS = 60;
const GOLDEN = (5 ** 0.5 - 1) / 2;
const NARROWED = 30; // golden sections towards an extremum

/** Follows the signs of root functions, {signs, value(t, x)}, from step to step. */
export class RootFinder {
  constructor(roots, t, x) {
    this.roots = roots;
    const first = roots.value(t, x);
    this.signs = Float64Array.from(roots.signs, (s, k) => (s === 0 ? Math.sign(first[k]) : s));
    this.which = this.signs.map(() => 0); // of those that vanish at the root found last
    this.place = { t, x: Float64Array.from(x) };
  }

  /** The place {t, x} in the last step at which the integration ends; null where it goes on. */
  first(method) {
    const found = this.next(method);
    if (found === null) this.place = { t: method.t, x: Float64Array.from(method.x) };
    return found;
  }

  next(method) {
    const { signs } = this;
    const curve = (time) => {
      const state = new Float64Array(method.x.length);
      method.interpolate(time, state);
      return this.roots.value(time, state);
    };
    const { times, values } = this.samples(method);
    let best = null;
    for (let k = 0; k < signs.length; k++) {
      const t = this.firstOf(k, times, values.map((v) => v[k]), (time) => curve(time)[k]);
      if (t !== null && (best === null || t < best.t)) best = { t, k };
    }
    const last = values[values.length - 1];
    if (best === null) {
      last.forEach((v, k) => {
        if (v !== 0 && !Number.isNaN(v)) signs[k] = Math.sign(v);
      });
      return null;
    }
    const atEnd = best.t === method.t;
    const at = atEnd ? last : curve(best.t);
    this.which = at.map((v, k) => Number(Math.sign(v) * signs[k] < 0 || k === best.k));
    const x = Float64Array.from(method.x);
    if (!atEnd) method.interpolate(best.t, x);
    return { t: best.t, x };
  }

  /** Times of the last step, and the functions there, close enough to follow them. */
  samples(method) {
    for (let inside = INSIDE; ; ) {
      const times = inside.map((share) => method.before + share * (method.t - method.before));
      times[times.length - 1] = method.t;
      const values = times.map((time, k) => {
        if (k === times.length - 1) return this.roots.value(time, method.x);
        if (time === this.place.t) return this.roots.value(time, this.place.x);
        const state = new Float64Array(method.x.length);
        method.interpolate(time, state);
        return this.roots.value(time, state);
      });
      if (inside.length > MOST_SAMPLES || !this.signs.some((sign, k) => unresolved(values.map((v) => v[k]), sign))) {
        return { times, values };
      }
      const finer = 2 * inside.length - 1;
      inside = Array.from({ length: finer }, (_, k) => k / (finer - 1));
    }
  }

  /** The first time at which function k has the other sign than before, null where it keeps its sign. */
  firstOf(k, times, values, curve) {
    const sign = this.signs[k] || Math.sign(values.find((v) => v !== 0) ?? 0);
    if (!sign) return null;
    const heights = values.map((v) => sign * v);
    if (heights[0] < 0) return times[0]; // against the sign it is said to have: at once
    const height = (t) => sign * curve(t);
    for (let i = 1; i < times.length; i++) {
      if (heights[i] < 0) return locate(height, times[i - 1], times[i], heights[i - 1], heights[i]);
      if (i + 1 < times.length && mayDip(heights[i - 1], heights[i], heights[i + 1])) {
        const low = lowest(height, times[i - 1], times[i + 1]);
        if (low.value < 0) return locate(height, times[i - 1], low.t, heights[i - 1], low.value);
      }
    }
    return null;
  }
}

/** Whether a function may be below zero somewhere between equidistant samples, for all these tell. */
function unresolved(values, sign) {
  let missed = 0;
  let least = Infinity;
  for (const v of values) least = Math.min(least, v * sign);
  for (let k = 2; k < values.length - 2; k++) {
    const middle = (4 * (values[k - 1] + values[k + 1]) - values[k - 2] - values[k + 2]) / 6;
    missed = Math.max(missed, Math.abs(values[k] - middle));
  }
  return missed > COARSE * (Math.max(...values) - Math.min(...values)) && least < 10 * missed;
}

/** Whether a smooth function may be below zero between places where it is not. */
function mayDip(before, here, behind) {
  return here > 0 && here <= Math.min(before, behind) && here < Math.max(before, behind) - here;
}

/** The end at which the curve is negative of the smallest bracket of its crossing from above zero. */
export function locate(curve, a, b, atA, atB) {
  for (let call = 0; call < MOST_CALLS; call++) {
    const least = TIGHTEST * Math.max(Math.abs(a), Math.abs(b));
    if (b - a <= 2 * least) break;
    const secant = (atA * b - atB * a) / (atA - atB);
    const near = NEARER.map((share) => share * (b - a));
    const all = [...near.map((d) => secant - d), secant, ...near.map((d) => secant + d), secant - least, secant + least, (a + b) / 2];
    const places = all.filter((t) => t > a && t < b).sort((p, q) => p - q);
    if (places.length === 0) break;
    let [low, high] = [0, places.length]; // bisection among the places: each evaluation costs
    const at = new Map();
    while (low < high) {
      const middle = (low + high) >> 1;
      at.set(middle, curve(places[middle]));
      if (at.get(middle) < 0) high = middle;
      else low = middle + 1;
    }
    if (high < places.length) [b, atB] = [places[high], at.get(high)];
    if (high > 0) [a, atA] = [places[high - 1], at.get(high - 1)];
  }
  return b;
}

/** A place and value of a minimum between two times (golden sections); where below zero, at once. */
function lowest(curve, a, b) {
  let c = b - GOLDEN * (b - a);
  let d = a + GOLDEN * (b - a);
  let atC = curve(c);
  let atD = curve(d);
  for (let k = 0; k < NARROWED && Math.min(atC, atD) >= 0; k++) {
    if (atC < atD) {
      [b, d, atD] = [d, c, atC];
      c = b - GOLDEN * (b - a);
      atC = curve(c);
    } else {
      [a, c, atC] = [c, d, atD];
      d = a + GOLDEN * (b - a);
      atD = curve(d);
    }
  }
  return atC < atD ? { t: c, value: atC } : { t: d, value: atD };
}
