// What happens to the laws of a scene at an instant, as `engine/c/transition.c`: the states are moved onto what is
// closed or closing, impulses change the velocities, and the forces decide which laws hold from here on.

import { collide } from "./impact.js";
import { Contradiction } from "./instant.js";
import { filled, indices, part } from "./matrix.js";
import { project } from "./manifold.js";
import { settle, solvingFor, STILL } from "./mode.js";

const AT_ONCE = 1e-10; // s; gaps that would close within that time close together
const TOUCHING = 1e-14; // gaps below this share of the lengths that make them are zero
const LOCATED = 1e-14; // s, or this share of the time: how exactly events are located
const TURNING = 1e-8; // s; a velocity that its accelerations undo in that time has come to zero by itself, not by a jump
const BOUNCES_LEFT = 1e-9; // s; where all bounces to come would take less, they are over …
const ELASTIC_TOGETHER = 1e2; // times that height where gaps that cannot be told from zero close among bounces without loss
const LEAST_HEIGHT = 1e-14; // … as where they are lower than this share of the lengths that make the gap
const HOLDS = 1e-6; // share of what a law alone would have to hold: beyond it a force is none of rounding

/**
 * What follows at the instant `here`: {before, now, mode, force, impulse, lost, impactLaw, touched, accumulated, until}.
 *
 * `trigger` has {closing, opening, direction, jumped}: open laws whose motion has come to zero, closed ones whose force
 * has come to its end, the direction in which friction among them begins to slide, and whether states have been changed
 * from outside, so that what is closed may move.
 */
export function transition(kinematics, here, mode, trigger) {
  const { table, count } = kinematics;
  const each = (test) => Array.from({ length: count }, (_, k) => Boolean(test(k)));
  const { unilateral, degree, impulsive, contact, normal } = table;
  let now = here;
  const touching = each(
    (k) => unilateral[k] && degree[k] >= 1 && (mode.closed[k] || trigger.closing[k] || aboutToClose(now, k)),
  );
  const holding = each((k) => mode.closed[k] && (!trigger.jumped || isTurning(here, k)));
  const atRest = each((k) => holding[k] || (trigger.closing[k] && isTurning(now, k)));
  now = project(kinematics, now, touching, each((k) => atRest[k] && !unilateral[k] && degree[k] === 2));
  const before = now;
  const striking = each((k) => impulsive[k] && (touching[k] || !unilateral[k])); // an open ratchet may be driven back
  const sharing = each((k) => striking[k] || (contact[k] && degree[k] === 2 && striking[normal[k]]));
  let impact = null;
  let over = filled(count, false);
  let until = -Infinity;
  let least = leastRates(now);
  if (indices(striking).some((k) => now.rate[k] < -least[k])) {
    const strike = (restitution) => {
      impact = impactAmong(table, before, sharing, restitution);
      now = behindImpact(kinematics, before, sharing, impact);
      const later = leastRates(now);
      least = least.map((v, k) => Math.max(v, later[k]));
    };
    strike(table.restitution);
    [over, until] = lastBounces(table, now, mode, each((k) => striking[k] && now.rate[k] > least[k]), trigger);
    const elastic = lastElastic(table, now, mode, striking, least, trigger);
    over = over.map((o, k) => o || elastic[k]);
    if (over.some(Boolean)) strike(table.restitution.map((e, k) => (over[k] ? 0 : e)));
  } else least = least.map((v, k) => (holding[k] ? Infinity : v)); // what has been closed is at rest
  const candidate = candidates(table, now, touching, least);
  const settled = settledAmong(table, now, mode, candidate, trigger);
  const { closed } = settled.mode;
  const gaps = each((k) => closed[k] && unilateral[k] && degree[k] >= 1);
  now = project(kinematics, now, gaps, each((k) => closed[k] && degree[k] === 2));
  const impulse = filled(count, 0);
  const lost = filled(count, 0);
  if (impact !== null) {
    indices(sharing).forEach((k, i) => {
      impulse[k] = impact.impulse[i];
      lost[k] = impact.lost[i];
    });
    for (const k of indices(each((k) => sharing[k] && contact[k]))) {
      lost[normal[k]] += lost[k]; // what friction takes counts as its contact's
      impulse[k] = lost[k] = 0;
    }
  }
  const touched = each((k) => touching[k] || (candidate[k] && !unilateral[k]));
  const impactLaw = impact === null ? "" : impact.law;
  return { before, now, mode: settled.mode, impulse, lost, impactLaw, touched, accumulated: over, until };
}

/**
 * The mode that holds from here on.
 *
 * A force that has come to zero by itself is zero up to rounding, and its law opens. Where other laws open at the same
 * instant it may have to hold after all: as of two that a jump of a load has set free.
 */
function settledAmong(table, now, mode, candidate, trigger) {
  const atLimit = mode.closed.map((c, k) => (c && trigger.opening[k] ? trigger.direction[k] : 0));
  const settling = (those) => settle(table, now, mode, those, slidingDirections(table, now, those, trigger), atLimit);
  let releasing = candidate.map((c, k) => c && trigger.opening[k] && !table.dry[k]);
  if (releasing.some(Boolean) && indices(mode.closed).length > 1) {
    const found = unlessContradicted(() => settling(candidate));
    const holds = (k) => {
      const alone = Math.abs(now.bias[k] / now.delassus[k][k]);
      return found.mode.closed[k] && found.unique[k] && found.force[k] > HOLDS * (alone || 0);
    };
    if (found !== null) releasing = releasing.map((r, k) => r && !holds(k));
  }
  return settling(candidate.map((c, k) => c && !releasing[k]));
}

function unlessContradicted(work) {
  try {
    return work();
  } catch (failed) {
    if (!(failed instanceof Contradiction)) throw failed;
    return null;
  }
}

const acceleration = (now, k) => Math.abs(now.bias[k]) + (Math.abs(now.delassus[k][k] * now.stick[k]) || 0);

const aboutToClose = (now, k) => now.gap[k] <= TOUCHING * now.gapScale[k] - AT_ONCE * Math.min(now.rate[k], 0);

/** Whether a rate is what the location of a root leaves of zero. */
const isTurning = (now, k) => Math.abs(now.rate[k]) <= STILL * now.rateScale[k] + TURNING * acceleration(now, k);

/** The rates below which a motion is at rest: rounding of the velocities, and of the time of the event. */
const leastRates = (now) =>
  now.rateScale.map((s, k) => STILL * s + LOCATED * Math.max(1, Math.abs(now.t)) * acceleration(now, k));

function impactAmong(table, now, striking, restitution) {
  const which = indices(striking);
  const rows = indices(which.map((k) => table.contact[k]));
  const normal = rows.map((i) => which.indexOf(table.normal[which[i]]));
  const friction = { rows, normal, share: rows.map((i) => now.stick[which[i]]) };
  const of = (values) => which.map((k) => values[k]);
  return solvingFor(which, "no impulses keep them", () =>
    collide(part(now.delassus, which, which), of(now.rate), of(restitution), friction),
  );
}

/** The instant behind an impact; the ledger's components do not take part. */
function behindImpact(kinematics, now, striking, impact) {
  const which = indices(striking);
  const change = now.response.map((row) => which.reduce((sum, k, i) => sum + row[k] * impact.impulse[i], 0));
  return kinematics.at(now.t, now.x.map((v, j) => (kinematics.ledger[j] ? v : v + change[j])));
}

/**
 * Which laws have bounced for the last time, and when all their further bounces would be over: a law that leaves with
 * rate r under an acceleration −a comes back after 2·r/a, and all further bounces take 2·r/(a·(1 − e)).
 */
function lastBounces(table, now, mode, left, trigger) {
  const e = table.restitution;
  const leaving = left.map((l, k) => l && trigger.closing[k] && e[k] > 0 && !table.lossless[k]);
  if (!leaving.some(Boolean)) return [leaving, -Infinity];
  const reached = table.impulsive.map((i, k) => i && !leaving[k]);
  const resting = candidates(table, now, reached, filled(e.length, 0));
  const sliding = slidingDirections(table, now, resting, trigger);
  const { level } = settle(table, now, mode, resting, sliding, filled(e.length, 0));
  const rest = leaving.map((l, k) => (l && level[k] < 0 ? (2 * now.rate[k]) / (-level[k] * (1 - e[k])) : Infinity));
  const low = now.rate.map((r, k) => r ** 2 <= -2 * level[k] * LEAST_HEIGHT * now.gapScale[k]);
  const over = leaving.map((l, k) => rest[k] < BOUNCES_LEFT || (l && level[k] < 0 && low[k]));
  return [over, now.t + Math.max(-Infinity, ...rest.filter((_, k) => over[k]))];
}

/**
 * Which laws have bounced for the last time with a law of e = 1 that other laws take the energy from: when the heights of
 * all these bounces are no longer told from zero, neither are the gaps between them.
 */
function lastElastic(table, now, mode, touching, least, trigger) {
  const e = table.restitution;
  const leaving = touching.map((s, k) => s && now.rate[k] > least[k]);
  const taking = indices(touching.map((s, k) => s && !table.lossless[k]));
  const isElastic = (k) => leaving[k] && trigger.closing[k] && table.lossless[k] && taking.some((j) => now.delassus[k][j] !== 0);
  const elastic = indices(leaving).filter(isElastic);
  if (elastic.length === 0) return filled(e.length, false);
  const resting = candidates(table, now, touching.map((s, k) => s && !leaving[k]), filled(e.length, 0));
  const sliding = slidingDirections(table, now, resting, trigger);
  const { level } = settle(table, now, mode, resting, sliding, filled(e.length, 0));
  const height = ELASTIC_TOGETHER * LEAST_HEIGHT;
  const low = leaving.map((l, k) => l && level[k] < 0 && now.rate[k] ** 2 <= -2 * level[k] * height * now.gapScale[k]);
  return elastic.some((k) => low[k]) ? low : filled(e.length, false);
}

/** The laws that could be closed without a jump. */
function candidates(table, now, touching, least) {
  return touching.map((own, k) => {
    const reached = own || !table.unilateral[k];
    if (table.degree[k] === 0) return true;
    return reached && (table.degree[k] === 1 || Math.abs(now.rate[k]) <= least[k]);
  });
}

/** The directions of friction that slides: as it moves or, just set free, as its last force has pulled. */
function slidingDirections(table, now, candidate, trigger) {
  return candidate.map((c, k) => {
    if (c || table.complementary[k]) return 0;
    return trigger.opening[k] ? trigger.direction[k] : Math.sign(now.rate[k]);
  });
}
