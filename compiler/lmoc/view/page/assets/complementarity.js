// Linear complementarity problems with bounds, by block principal pivoting, as `engine/c/complementarity.c`, which
// cites the papers: x = lower and w ≥ 0, or lower < x < upper and w = 0, or x = upper and w ≤ 0, with w = M·x + q.

import { filled, indices, inverse, leastSquares, part, product, singular, solved, termsOf } from "./matrix.js";

export const LOWER = -1;
export const FREE = 0;
export const UPPER = 1;
export const NEGLIGIBLE = 1e-11; // violations below this share of the terms they are the sum of count as none …
const OF_ALL_TERMS = 1e-14; // … and below this one of the largest terms of all
const PROXIMAL = 1e-6; // shift of the diagonal, as a share of it
const MOST_PROXIMAL = 8;
const PATIENCE = 8; // block exchanges without fewer violations before components are exchanged one at a time
const DEPENDENT = 1e-11; // singular values below this share of the largest one are those of dependent constraints
const TINY = 2.2e-308;

/** The problem has no solution, or none was found; `x` is the last iterate. */
export class NoSolution extends Error {
  constructor(x) {
    super("the complementarity problem has no solution");
    this.x = x;
  }
}

/**
 * Solve one problem: {x, w, side, unique}.
 *
 * `matrix` is positive semidefinite, or a P-matrix; `side` says where to begin, such as the answer to the problem before.
 */
export function solveComplementarity(matrix, q, lower, upper, side = null) {
  const n = q.length;
  if (n === 0) return { x: [], w: [], side: [], unique: [] };
  const most = Math.max(...matrix.map((row, k) => row[k]));
  const diagonal = matrix.map((row, k) => (row[k] > 0 ? row[k] : most > 0 ? most : 1));
  const regular = matrix.map((row, i) => Float64Array.from(row, (v, j) => (i === j ? v + PROXIMAL * diagonal[i] : v)));
  let x = q.map((_, k) => Math.min(Math.max(0, lower[k]), upper[k]));
  side = side ?? filled(n, LOWER);
  for (let step = 0; step < MOST_PROXIMAL; step++) {
    const shifted = q.map((v, k) => v - PROXIMAL * diagonal[k] * x[k]);
    [x, side] = pivot(regular, shifted, lower, upper, side);
    x = polished(matrix, q, x, side);
    const w = product(matrix, x).map((v, k) => v + q[k]);
    const slack = slackOf(matrix, q, x);
    const holds = w.every((v, k) => side[k] !== FREE || Math.abs(v) <= slack[k]);
    if (holds && violations(x, w, side, lower, upper, slack, diagonal).length === 0) {
      return {
        x: x.map((v, k) => Math.min(Math.max(v, lower[k]), upper[k])),
        w: w.map((v, k) => (side[k] === FREE ? 0 : v)),
        side,
        unique: determined(matrix, side),
      };
    }
  }
  throw new NoSolution(x);
}

/** Solve a problem whose matrix is a P-matrix: [x, side]. */
function pivot(matrix, q, lower, upper, from) {
  const n = q.length;
  const diagonal = matrix.map((row, k) => row[k]);
  let side = from.map((s, k) => {
    if (lower[k] === upper[k]) return LOWER;
    return Number.isFinite(s === LOWER ? lower[k] : s === UPPER ? upper[k] : 0) ? s : FREE;
  });
  let fewest = n + 1;
  let patience = PATIENCE;
  let x = [];
  for (let round = 0; round < 100 + 2000 * n; round++) {
    x = pointOf(matrix, q, lower, upper, side);
    if (!x.every(Number.isFinite)) break;
    const w = product(matrix, x).map((v, k) => v + q[k]);
    let violated = violations(x, w, side, lower, upper, slackOf(matrix, q, x), diagonal);
    if (violated.length === 0) return [x, side];
    if (violated.length < fewest) [fewest, patience] = [violated.length, PATIENCE];
    else if (patience > 0) patience--;
    else violated = violated.slice(-1);
    side = [...side];
    for (const k of violated) side[k] = side[k] !== FREE ? FREE : x[k] < lower[k] ? LOWER : UPPER;
  }
  throw new NoSolution(x);
}

/** By how much each component of w may be wrong: a share of its terms, and rounding of the others'. */
function slackOf(matrix, q, x) {
  const terms = termsOf(matrix, x).map((v, k) => v + Math.abs(q[k]));
  const all = OF_ALL_TERMS * Math.max(...terms);
  return terms.map((v) => NEGLIGIBLE * v + all);
}

/** x with its components at their bounds or, where they are free, such that w = 0. */
function pointOf(matrix, q, lower, upper, side) {
  const x = side.map((s, k) => (s === LOWER ? lower[k] : s === UPPER ? upper[k] : 0));
  const free = side.flatMap((s, k) => (s === FREE ? [k] : []));
  if (free.length) {
    const right = free.map((k) => -(q[k] + matrix[k].reduce((sum, v, j) => sum + v * x[j], 0)));
    const found = solved(part(matrix, free, free), right);
    free.forEach((k, i) => (x[k] = found[i]));
  }
  return x;
}

const scaleOf = (matrix, rows) => rows.map((k) => 1 / Math.sqrt(Math.max(matrix[k][k], TINY)));

/** The solution of the unshifted equations w = 0 of the free components that is nearest to x. */
function polished(matrix, q, from, side) {
  const free = side.flatMap((s, k) => (s === FREE ? [k] : []));
  const x = [...from];
  if (free.length === 0) return x;
  const scale = scaleOf(matrix, free);
  const scaled = part(matrix, free, free).map((row, i) => row.map((v, j) => v * scale[i] * scale[j]));
  const back = inverse(scaled, 1 / DEPENDENT);
  for (let round = 0; round < 2; round++) {
    const missed = free.map((k, i) => scale[i] * (matrix[k].reduce((sum, v, j) => sum + v * x[j], 0) + q[k]));
    const change = back === null ? leastSquares(scaled, missed, DEPENDENT) : product(back, missed);
    free.forEach((k, i) => (x[k] -= scale[i] * change[i]));
  }
  return x;
}

/** The components that are not where their conditions want them, by more than `slack` in w. */
function violations(x, w, side, lower, upper, slack, diagonal) {
  return indices(
    side.map((s, k) => {
      const beyond = slack[k] / diagonal[k];
      if (s === FREE) return x[k] < lower[k] - beyond || x[k] > upper[k] + beyond;
      return lower[k] < upper[k] && (s === LOWER ? w[k] < -slack[k] : w[k] > slack[k]);
    }),
  );
}

/** Which components do not change along the null space of the free part. */
function determined(matrix, side) {
  const unique = filled(side.length, true);
  const free = side.flatMap((s, k) => (s === FREE ? [k] : []));
  if (free.length === 0) return unique;
  const scale = scaleOf(matrix, free);
  const scaled = part(matrix, free, free).map((row, i) => row.map((v, j) => v * scale[i] * scale[j]));
  if (inverse(scaled, 1 / DEPENDENT) !== null) return unique;
  const { values, v } = singular(scaled);
  const none = DEPENDENT * Math.max(...values, TINY);
  free.forEach((k, i) => (unique[k] = values.every((s, j) => s > none || Math.abs(v[i][j]) < 1e-8)));
  return unique;
}
