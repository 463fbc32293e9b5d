// Impacts: the impulses with which closed and closing laws stop each other at the same instant, as `engine/c/impact.c`.
// Newton's law with restitution for all laws simultaneously; where it creates energy or contradicts itself, Poisson's.

import { FREE, LOWER, NEGLIGIBLE, NoSolution, solveComplementarity } from "./complementarity.js";
import { filled, largest, leastSquares, product, termsOf } from "./matrix.js";

const MOST_LIMITS = 50; // limits of friction tried one after the other
const CREATED = 1e-12; // energy gained beyond this share of the energy that the impact turns over counts as created

/**
 * The impact of laws that touch: {impulse, rate, lost, law, unique}.
 *
 * `rate` before the impact; `friction` has {rows, normal, share}: which laws are friction, those of their normal
 * impulses, and the share of these that they give at the most.
 */
export function collide(delassus, rate, restitution, friction) {
  let newton;
  try {
    newton = newtonImpact(delassus, rate, restitution, friction);
  } catch (failed) {
    if (!(failed instanceof NoSolution)) throw failed;
    return poissonImpact(delassus, rate, restitution, friction);
  }
  const turned = newton.impulse.reduce((sum, v, k) => sum + Math.abs(v) * (Math.abs(rate[k]) + Math.abs(newton.rate[k])), 0);
  const lost = newton.lost.reduce((sum, v) => sum + v, 0);
  return -lost <= CREATED * turned ? newton : poissonImpact(delassus, rate, restitution, friction);
}

function newtonImpact(delassus, rate, restitution, friction) {
  const wanted = rate.map((v, k) => (friction.rows.includes(k) ? 0 : restitution[k] * Math.min(v, 0)));
  const found = impulses(delassus, rate.map((v, k) => v + wanted[k]), filled(rate.length, 0), friction);
  return impactOf(rate, found.x, found.w.map((v, k) => v - wanted[k]), "Newton", found.unique);
}

function poissonImpact(delassus, rate, restitution, friction) {
  const compression = impulses(delassus, rate, filled(rate.length, 0), friction);
  const least = compression.x.map((v, k) => restitution[k] * v);
  const expansion = impulses(delassus, compression.w, least, friction);
  const impulse = compression.x.map((v, k) => v + expansion.x[k]);
  const unique = compression.unique.map((u, k) => u && expansion.unique[k]);
  return impactOf(rate, impulse, expansion.w, "Poisson", unique);
}

function impactOf(before, impulse, after, law, unique) {
  return { impulse, rate: after, lost: impulse.map((v, k) => -0.5 * v * (before[k] + after[k])), law, unique };
}

/** Impulses, at least some of the laws without friction; the limits of friction follow from the answer. */
function impulses(delassus, q, least, friction) {
  const upper = filled(q.length, Infinity);
  if (friction.rows.length === 0) return solveComplementarity(delassus, q, least, upper);
  const lower = [...least];
  for (const k of friction.rows) lower[k] = upper[k] = 0;
  let found = solveComplementarity(delassus, q, lower, upper);
  let side = null;
  for (let round = 0; round < MOST_LIMITS; round++) {
    friction.rows.forEach((k, i) => {
      upper[k] = friction.share[i] * found.x[friction.normal[i]];
      lower[k] = -upper[k];
    });
    found = solveComplementarity(delassus, q, lower, upper, side);
    if (side !== null && found.side.every((s, k) => s === side[k])) {
      const exact = withSides(delassus, q, least, friction, found);
      if (exact !== null) return exact;
    }
    side = found.side;
  }
  throw new NoSolution(found.x);
}

/** The solution in which everything is on the side found; null where that is none. */
function withSides(delassus, q, least, friction, found) {
  const { side } = found;
  const matrix = q.map((_, i) => Float64Array.from(q, (_, j) => (side[i] === FREE ? delassus[i][j] : Number(i === j))));
  const right = q.map((v, k) => (side[k] === FREE ? -v : side[k] === LOWER ? least[k] : 0));
  friction.rows.forEach((k, i) => {
    if (side[k] === FREE) return;
    matrix[k][friction.normal[i]] -= (side[k] === LOWER ? -1 : 1) * friction.share[i];
    right[k] = 0;
  });
  const x = leastSquares(matrix, right, 2.2e-16 * q.length);
  const w = product(delassus, x).map((v, k) => v + q[k]);
  const lower = [...least];
  const upper = filled(q.length, Infinity);
  friction.rows.forEach((k, i) => {
    upper[k] = friction.share[i] * x[friction.normal[i]];
    lower[k] = -upper[k];
  });
  const slack = termsOf(delassus, x).map((v, k) => NEGLIGIBLE * (v + Math.abs(q[k])));
  const size = NEGLIGIBLE * (largest(x) + largest(found.x));
  const missed = largest(product(matrix, x).map((v, k) => v - right[k]));
  const good =
    missed <= Math.max(size, ...slack) &&
    x.every((v, k) => v >= lower[k] - size && v <= upper[k] + size) &&
    w.every((v, k) => side[k] === FREE || (side[k] === LOWER ? v >= -slack[k] : v <= slack[k]));
  return good ? { x, w: w.map((v, k) => (side[k] === FREE ? 0 : v)), side, unique: found.unique } : null;
}
