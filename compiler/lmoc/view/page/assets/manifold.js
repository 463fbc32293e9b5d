// Gaps, rates and sliding velocities that closed laws keep at zero, and the projection onto them, as `engine/c/project.c`.

import { Contradiction } from "./instant.js";
import { indices, largest, termsOf } from "./matrix.js";

const MOST_NEWTON = 12;
const CLOSE = 2e-16; // residual, as a share of the terms that make it
const NOT_NEARER = 1e-12; // the same, where Newton's method does not come nearer
const OF_ERRORS = 1e3; // such errors: by what a gap may have drifted that follows from the states and from a given motion
const NO_PIVOT = 1e-10; // a pivot below this share of the largest entry of its row: the row depends on others

/**
 * The nearby instant at which some gaps and rates are zero. Of two gaps of one coordinate, such as those of a load that a
 * prescribed rope sets down on a floor, one is zero to rounding, the other within the errors of the integrator.
 */
export function project(kinematics, from, gaps, rates) {
  let now = from;
  const ofGaps = indices(gaps);
  const ofRates = indices(rates);
  if (ofGaps.length + ofRates.length === 0) return now;
  let residue = Infinity;
  let drifted = false;
  for (let k = 0; k < MOST_NEWTON; k++) {
    const value = [...ofGaps.map((i) => now.gap[i]), ...ofRates.map((i) => now.rate[i])];
    const matrix = [...ofGaps.map((i) => now.gapSlope[i]), ...ofRates.map((i) => now.rateSlope[i])];
    const terms = termsOf(matrix, now.x);
    if (value.every((v, i) => Math.abs(v) <= CLOSE * terms[i])) return now;
    const before = residue;
    residue = largest(value);
    const near = value.every((v, i) => Math.abs(v) <= NOT_NEARER * (terms[i] + residue));
    if (residue >= 0.5 * before && near) return now;
    const slack = ofDrift(kinematics, matrix);
    drifted = value.every((v, i) => Math.abs(v) <= slack[i]);
    const change = correction(matrix, value.map((v) => -v));
    now = kinematics.at(now.t, now.x.map((v, j) => v + change[j]));
  }
  if (drifted) return now;
  throw new Contradiction([...new Set([...ofGaps, ...ofRates])], "no states nearby satisfy them");
}

/** By what gaps or rates may have drifted that have these derivatives by the states. */
export function ofDrift({ errors }, slopes) {
  return slopes.map((row) => OF_ERRORS * (errors === null ? 0 : row.reduce((sum, v, j) => sum + Math.abs(v) * errors[j], 0)));
}

/** dx with matrix·dx = right and as few entries as independent rows (Gauss-Jordan, full pivoting). */
export function correction(matrix, right) {
  const columns = matrix[0].length;
  const work = matrix.map((row, i) => [...row, right[i]]);
  const scale = matrix.map(largest);
  const left = scale.map((s) => s > 0);
  const dx = new Float64Array(columns);
  const chosen = [];
  while (left.some(Boolean)) {
    let [most, row, column] = [-1, 0, 0];
    work.forEach((own, i) => {
      if (!left[i]) return;
      for (let j = 0; j < columns; j++) {
        const share = Math.abs(own[j]) / scale[i];
        if (share > most) [most, row, column] = [share, i, j];
      }
    });
    if (!(most > NO_PIVOT)) break;
    const pivot = work[row][column];
    work[row] = work[row].map((v) => v / pivot);
    work.forEach((own, i) => {
      const factor = own[column];
      if (i !== row && factor !== 0) work[i] = own.map((v, j) => v - factor * work[row][j]);
    });
    left[row] = false;
    chosen.push([row, column]);
  }
  for (const [row, column] of chosen) dx[column] = work[row][columns];
  return dx;
}
