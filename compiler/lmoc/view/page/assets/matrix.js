// Small dense matrices as arrays of rows, and what is asked of them where they may be singular.

import { factorize, substitute } from "./linear.js";

export const zeroMatrix = (rows, columns) => Array.from({ length: rows }, () => new Float64Array(columns));

/** The indices at which a mask is true. */
export const indices = (mask) => [...mask.keys()].filter((k) => mask[k]);

export const filled = (n, value) => Array(n).fill(value);

export const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);

export const product = (matrix, x) => matrix.map((row) => dot(row, x));

/** |matrix|·|x| */
export const termsOf = (matrix, x) => matrix.map((row) => row.reduce((sum, v, k) => sum + Math.abs(v * x[k]), 0));

export const part = (matrix, rows, columns) => rows.map((i) => columns.map((j) => matrix[i][j]));

export const largest = (values) => values.reduce((most, v) => Math.max(most, Math.abs(v)), 0);

/** A function that solves with a regular matrix; it answers NaN where the matrix is singular. */
function solver(matrix) {
  const n = matrix.length;
  const a = Float64Array.from(matrix.flatMap((row) => [...row]));
  const pivots = new Int32Array(n);
  const regular = factorize(a, n, pivots) !== 0;
  return (right) => {
    const x = Float64Array.from(right);
    if (regular) substitute(a, n, pivots, x);
    else x.fill(NaN);
    return x;
  };
}

export const solved = (matrix, right) => solver(matrix)(right);

const columnNorm = (matrix) => Math.max(...matrix.map((_, j) => matrix.reduce((sum, row) => sum + Math.abs(row[j]), 0)));

/** The inverse of a square matrix whose condition is below a bound; null for others. */
export function inverse(matrix, worst) {
  const n = matrix.length;
  const by = solver(matrix);
  const columns = matrix.map((_, j) => by(matrix.map((_, i) => (i === j ? 1 : 0))));
  if (columns.some((column) => !column.every(Number.isFinite))) return null;
  const found = matrix.map((_, i) => columns.map((column) => column[i]));
  return n === 0 || columnNorm(matrix) * columnNorm(found) < worst ? found : null;
}

/**
 * Singular values and vectors, {u, values, v} with matrix = u·diag(values)·vᵀ, by rotations of its columns (M. R.
 * Hestenes, Inversion of matrices by biorthogonalization, J. SIAM 6, 1958). Columns of `u` are not normalized:
 * they have the singular values as their lengths.
 */
export function singular(matrix) {
  const n = matrix[0].length;
  const u = matrix.map((row) => Float64Array.from(row));
  const v = Array.from({ length: n }, (_, i) => Float64Array.from({ length: n }, (_, j) => Number(i === j)));
  for (let sweep = 0, turning = true; turning && sweep < 60; sweep++) {
    turning = false;
    for (let p = 0; p < n; p++) {
      for (let q = p + 1; q < n; q++) {
        let [a, b, c] = [0, 0, 0];
        for (const row of u) {
          a += row[p] * row[p];
          b += row[q] * row[q];
          c += row[p] * row[q];
        }
        if (Math.abs(c) <= 1e-15 * Math.sqrt(a * b) || c === 0) continue;
        turning = true;
        const zeta = (b - a) / (2 * c);
        const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.hypot(1, zeta));
        const cosine = 1 / Math.hypot(1, t);
        for (const row of [...u, ...v]) {
          const kept = row[p];
          row[p] = cosine * kept - cosine * t * row[q];
          row[q] = cosine * t * kept + cosine * row[q];
        }
      }
    }
  }
  const values = v.map((_, j) => Math.sqrt(u.reduce((sum, row) => sum + row[j] * row[j], 0)));
  return { u, values, v };
}

/** The shortest vector that minimizes |matrix·x − right|; singular values below a share of the largest count as none. */
export function leastSquares(matrix, right, share) {
  const { u, values, v } = singular(matrix);
  const least = share * Math.max(...values);
  const along = values.map((s, j) => (s > least ? u.reduce((sum, row, i) => sum + row[j] * right[i], 0) / (s * s) : 0));
  return v.map((row) => dot(row, along));
}
