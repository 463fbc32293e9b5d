// The next mode: which laws hold once everything at an instant is taken together, as `engine/c/mode.c`.
//
// A mode is {closed, direction, implied, push}, an entry for each law: whether it is closed, the sign of the sliding
// velocity of open friction, whether others hold its motion already, and then its constant force.

import { FREE, LOWER, NoSolution, solveComplementarity } from "./complementarity.js";
import { Contradiction } from "./instant.js";
import { dot, filled, indices, largest, part, product, termsOf, zeroMatrix } from "./matrix.js";

export const STILL = 1e-11; // rates below this share of the velocities that make them are zero
const POSITION = 2; // degree of a law between inertias
const IMPLIED = 1e-9; // what elimination leaves of the diagonal of a law that depends on others
const IN_CONE = 1e-10; // by which a contact friction may pass its limit and still stick
const RESTING = 1e-9; // share of its terms below which an acceleration is zero
const AT_LIMIT = 1e-9; // share of the limits within which frictions give way together
const HELD = 0.1; // of the acceleration by this share of its limit: if it is less, others hold friction at its limit
const TAKES_PART = 1e-3; // of the largest iterate: a component below it does not take part in a contradiction

export function freeMode(count) {
  const none = () => filled(count, false);
  return { closed: none(), direction: filled(count, 0), implied: none(), push: filled(count, 0) };
}

/** Turn a problem without a solution into a contradiction between the laws that its components belong to. */
export function solvingFor(laws, reason, work) {
  try {
    return work();
  } catch (failed) {
    if (!(failed instanceof NoSolution)) throw failed;
    const most = largest(failed.x);
    throw new Contradiction(laws.filter((_, k) => !(Math.abs(failed.x[k]) < TAKES_PART * most)), reason);
  }
}

/**
 * The mode that holds from an instant on, with its forces: {mode, force, level, unique}; `unique` forces are determined.
 *
 * `candidate` laws could be closed from here on; `sliding` is the direction of friction that is none; in the direction
 * `atLimit` stuck friction begins to slide that has just reached its limit.
 */
export function settle(table, now, mode, candidate, sliding, atLimit) {
  const n = candidate.length;
  const stuck = [...candidate];
  const released = filled(n, false);
  const pinned = candidate.map((c, k) => (c && table.dry[k] ? atLimit[k] : 0));
  const direction = candidate.map((c, k) => (c || table.complementary[k] ? 0 : sliding[k]));
  const share = pinned.some((p) => p !== 0) ? 1 - AT_LIMIT : 1;
  let side = candidate.map((c, k) => (mode.closed[k] || c ? FREE : LOWER));
  let force, unique, level, spare;
  for (;;) {
    const limit = now.stick.map((s, k) => share * (released[k] ? Math.min(now.slip[k], s) : s));
    const bounds = boundsOf(table, limit, pinned.map((p, k) => (released[k] ? 0 : p)));
    ({ force, side, unique } = forcesOf(table, now, stuck, direction, side, bounds));
    level = product(now.delassus, force).map((v, k) => v + now.bias[k]);
    spare = level.map((v, k) => {
      const alone = now.delassus[k][k] * AT_LIMIT * limit[k]; // its acceleration, were there nobody else to hold more
      return table.dry[k] && !released[k] && limit[k] > 0 && Math.abs(v) <= HELD * alone;
    });
    const passes = stuck.map((s, k) => s && table.dry[k] && side[k] !== FREE && !released[k] && !spare[k]);
    const weaker = passes.some((p, k) => p && (now.slip[k] < now.stick[k] || pinned[k] !== 0));
    const slips = indices(stuck.map((s, k) => s && table.contact[k] && beyondCone(table, now, force, k)));
    if (!weaker && slips.length === 0) break;
    passes.forEach((p, k) => (released[k] ||= p));
    for (const k of slips) {
      direction[k] = -Math.sign(force[k]);
      stuck[k] = false;
    }
  }
  const closed = stuck.map((s, k) => s && (side[k] === FREE || spare[k]));
  stuck.forEach((s, k) => {
    if (!s || !table.dry[k] || closed[k]) return;
    direction[k] = force[k] === 0 ? (level[k] < 0 ? -1 : 1) : -Math.sign(force[k]);
  });
  const terms = termsOf(now.delassus, force).map((v, k) => v + Math.abs(now.bias[k]));
  const small = level.map((v, k) => Math.abs(v) <= RESTING * terms[k]);
  const resting = candidate.map((c, k) => c && ((!closed[k] && small[k] && table.degree[k] === POSITION) || direction[k] !== 0));
  let implied = filled(n, false);
  if (resting.some(Boolean) || closed.some((c, k) => c && (side[k] !== FREE || !unique[k]))) {
    implied = dependent(table, now, direction, closed, resting, side);
    // where a motion turns, a force in its direction may do nothing for an instant: nobody holds it there
    implied = implied.map((i, k) => i && (closed[k] || small[k]));
  }
  const push = force.map((f, k) => (closed[k] && implied[k] ? (side[k] === FREE ? f : f / share) : 0));
  return { mode: { closed, direction, implied, push }, force, level, unique };
}

/** Solve for the forces of the laws in `stuck`; those of sliding friction follow from them. */
function forcesOf(table, now, stuck, direction, from, [lower, upper]) {
  const n = stuck.length;
  const active = indices(stuck);
  const { constant, share } = slidingForces(table, now, direction);
  const spread = share.map((row, i) => active.map((j) => Number(i === j) + row[j]));
  const matrix = active.map((i) => active.map((_, c) => dot(now.delassus[i], spread.map((row) => row[c]))));
  const q = active.map((i) => now.bias[i] + dot(now.delassus[i], constant));
  const of = (values) => active.map((k) => values[k]);
  const found = solvingFor(active, "no forces keep them", () => solveComplementarity(matrix, q, of(lower), of(upper), of(from)));
  const side = filled(n, LOWER);
  const unique = filled(n, true);
  active.forEach((k, i) => {
    side[k] = found.side[i];
    unique[k] = found.unique[i];
  });
  return { force: spread.map((row, k) => constant[k] + dot(row, found.x)), side, unique };
}

/** The bounds [lower, upper] of forces; equal ones for friction that is pinned to its limit. */
function boundsOf(table, limit, pinned) {
  const at = pinned.map((p, k) => (p === 0 ? null : -p * (limit[k] || 0)));
  const upper = limit.map((v, k) => at[k] ?? (table.dry[k] ? v : Infinity));
  return [limit.map((v, k) => at[k] ?? (table.complementary[k] ? 0 : -(table.dry[k] ? v : Infinity))), upper];
}

/**
 * The closed and resting laws that depend on other closed ones, by Gaussian elimination: complementarities come first,
 * and friction that can hold more before friction at its limit.
 */
function dependent(table, now, direction, closed, resting, side) {
  const n = closed.length;
  const { share } = slidingForces(table, now, direction);
  const friction = closed.map((c, k) => c && !table.complementary[k]);
  const groups = [
    closed.map((c, k) => c && table.complementary[k]),
    friction.map((f, k) => f && side[k] === FREE),
    friction.map((f, k) => f && side[k] !== FREE),
    resting,
  ];
  const order = groups.flatMap(indices);
  const spread = share.map((row, i) => Float64Array.from(row, (v, j) => v + Number(i === j)));
  const whole = zeroMatrix(n, n).map((row, i) => row.map((_, j) => dot(now.delassus[i], spread.map((own) => own[j]))));
  const matrix = part(whole, order, order);
  const scale = matrix.map((row, k) => Math.sqrt(Math.max(row[k], 2.2e-308)));
  const work = matrix.map((row, i) => row.map((v, j) => v / (scale[i] * scale[j])));
  const implied = filled(n, false);
  order.forEach((law, k) => {
    if (work[k][k] <= IMPLIED) {
      implied[law] = true;
      return;
    }
    if (resting[law]) return; // it begins to move, and holds nothing
    for (let i = k + 1; i < order.length; i++) {
      const factor = work[i][k] / work[k][k];
      for (let j = 0; j < order.length; j++) work[i][j] -= factor * work[k][j];
    }
  });
  return implied;
}

/** The forces of sliding friction: constants, and shares of the other laws' forces. */
function slidingForces(table, now, direction) {
  const n = direction.length;
  const constant = direction.map((d, k) => (d !== 0 && table.dry[k] ? -d * now.slip[k] : 0));
  const share = zeroMatrix(n, n);
  direction.forEach((d, k) => {
    if (d !== 0 && table.contact[k]) share[k][table.normal[k]] = -d * now.slip[k];
  });
  return { constant, share };
}

/** Whether a contact friction pulls with more than its share of the normal force. */
function beyondCone(table, now, force, k) {
  return Math.abs(force[k]) > now.stick[k] * Math.max(force[table.normal[k]], 0) * (1 + IN_CONE);
}
