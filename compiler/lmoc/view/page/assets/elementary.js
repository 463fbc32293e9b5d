// The names that written programs use for the functions of C.

export const { sin, cos, tan, asin, acos, atan, sinh, cosh, tanh, asinh, acosh, atanh } = Math;
export const { exp, log, log10, sqrt, pow, atan2, floor, ceil } = Math;
export const fabs = Math.abs;
export const NAN = NaN;
export const INFINITY = Infinity;

// as in C, these do not drop an argument that is not a number
export const lmoc_min = Math.min;
export const lmoc_max = Math.max;
export const lmoc_sign = Math.sign;

export function lmoc_mod(x, y) {
  return x - Math.floor(x / y) * y;
}

export function lmoc_quotient(x, y) {
  return Math.trunc(x / y);
}

export function lmoc_rem(x, y) {
  return x - Math.trunc(x / y) * y;
}

/** Fill w[out[i]] with the sum of coefficient[j]·w[index[j]] over j in start[i] … start[i+1]-1. */
export function totals(w, start, index, coefficient, out) {
  for (let i = 0; i < out.length; i++) {
    let sum = 0;
    for (let j = start[i]; j < start[i + 1]; j++) sum += coefficient[j] * w[index[j]];
    w[out[i]] = sum;
  }
}
