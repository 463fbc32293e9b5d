/* Friction between springs (`jenkins.h`).

   Its force is a state, and what its law decides about are rates. While the force is within its limits the friction
   sticks. At a limit, with the sliding direction d and the rate p of what the force exceeds the limit by,

       p >= 0, velocity >= 0 for d = 1,   p <= 0, velocity <= 0 for d = -1,   one of them zero,   velocities = bias + W p,

   is one complementarity problem for all such friction of a scene, for springs pass rates on to each other. W is the
   compliance of the springs, and the answer Prandtl's and Reuss's: elastic steps within the limits, slip along them (W. D.
   Iwan, A distributed-element model for hysteresis, J. Appl. Mech. 33, 1966; J. J. Moreau, Evolution problem associated
   with a moving convex set, J. Differential Equations 26, 1977).

   A force beyond its limit, because the limit has jumped or slips at less than it has held, gives way at once: the springs
   move by as much as brings all forces within their limits. */

#include "jenkins.h"
#include "dense.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double AT_LIMIT = 1e-8;  /* share of a limit within which a force is at it: so well is it known at usual
                                         tolerances */
static const double SHORTLY = 1e-7;   /* s, or this share of the time: where a velocity that turns has its new sign */
static const double INSTANT = 1e-7;   /* share of the springs' own movement that is left out where forces jump */
static const double MOVED = 1e-13;    /* share of the forces below which they have not been moved */

/* All of it at an instant; `own` has what is sought. */
typedef struct {
  const lmoc_kinematics *k;
  lmoc_contact *now, *spare;
  lmoc_impact *own;
  int64_t n, *side, *pinned;
  double *matrix, *u, *v, *q, *force, *lower, *upper, *low, *high, *scale;
  lmoc_flag *released, *unique;
} springs;

static int make(const lmoc_kinematics *k, lmoc_contact *now, lmoc_contact *spare, lmoc_impact *own, springs *s) {
  own->count = 0;
  for (int64_t i = 0; i < k->laws.count; i++)
    if (k->laws.degree[i] == LMOC_JENKINS) own->which[own->count++] = i;
  const int64_t n = own->count;
  double *m = n ? malloc((size_t)(3*n*n + 12*n) * sizeof(double)) : 0, *rest = m + 3*n*n;
  *s = (springs){.k = k, .now = now, .spare = spare, .own = own, .n = n};
  if (!m) return n ? LMOC_NO_MEMORY : LMOC_SOLVED;
  double **rows[] = {&s->q, &s->force, &s->lower, &s->upper, &s->low, &s->high, &s->scale};
  s->matrix = m, s->u = m + n*n, s->v = m + 2*n*n;
  for (int i = 0; i < 7; i++, rest += n) *rows[i] = rest;
  s->side = (int64_t *)rest, s->pinned = s->side + n;
  s->released = (lmoc_flag *)(s->pinned + n), s->unique = s->released + n;
  lmoc_part_of(now, k->laws.count, own, s->matrix);
  for (int64_t i = 0; i < n; i++) s->force[i] = now->force[own->which[i]];
  return LMOC_SOLVED;
}

/* Find x between `low` and `high`, which begins on a side. */
static int solve(const springs *s, int64_t side) {
  for (int64_t i = 0; i < s->n; i++) s->side[i] = side;
  return lmoc_complementarity(s->n, s->matrix, s->q, s->low, s->high, s->own->impulse, s->own->rate, s->side, s->unique);
}

/* Between which the forces are; a ratchet between springs only pushes. */
static void bound(const springs *s) {
  for (int64_t i = 0; i < s->n; i++) {
    const int64_t law = s->own->which[i];
    s->upper[i] = s->k->laws.complementary[law] ? INFINITY : s->released[i] ? s->now->slip[law] : s->now->stick[law];
    s->lower[i] = s->k->laws.complementary[law] ? 0 : -s->upper[i];
  }
}

/* Rates of the forces from here on, at constant limits. */
static void onwards(const springs *s, const lmoc_flag *limits) {
  for (int64_t i = 0; i < s->n; i++) {
    s->low[i] = limits[s->own->which[i]] & LMOC_AT_LOWER ? 0 : -INFINITY;
    s->high[i] = limits[s->own->which[i]] & LMOC_AT_UPPER ? 0 : INFINITY;
  }
}

static lmoc_flag limit_of(const springs *s, int64_t i, double force) {
  return (force <= s->lower[i] + AT_LIMIT * s->scale[i] ? LMOC_AT_LOWER : 0) |
         (force >= s->upper[i] - AT_LIMIT * s->scale[i] ? LMOC_AT_UPPER : 0);
}

/* The instant at which velocities that are prescribed and just turn have their new signs, in a mode. */
static int shortly(const springs *s, const lmoc_settled *mode) {
  const lmoc_contact *now = s->now;
  double time = now->time + SHORTLY * fmax(1, fabs(now->time));
  for (int64_t i = 0; i < s->n; i++) {
    const int64_t law = s->own->which[i];
    if (fabs(now->rate[law]) > SHORTLY * now->rate_scale[law]) time = now->time;
  }
  memcpy(s->spare->x, now->x, (size_t)s->k->states * sizeof(double));
  s->spare->time = time;
  return s->k->at(s->k->owner, time, s->spare->x, mode, s->spare->x + s->k->states) ? LMOC_HELD_UP : LMOC_SOLVED;
}

/* Have forces give way that are beyond their limits. What begins to slide is at the limit of sliding. */
static int give_way(const springs *s) {
  for (int more = 1; more;) {
    more = 0;
    bound(s);
    for (int64_t i = 0; i < s->n; i++) {
      s->q[i] = 0;
      s->low[i] = (s->pinned[i] > 0 ? s->upper[i] : s->lower[i]) - s->force[i];
      s->high[i] = (s->pinned[i] < 0 ? s->lower[i] : s->upper[i]) - s->force[i];
    }
    const int failed = solve(s, LMOC_FREE);
    if (failed) return failed;
    for (int64_t i = 0; i < s->n; i++) {
      if (s->released[i] || s->side[i] == LMOC_FREE) continue;
      s->released[i] = more = 1;
      s->pinned[i] = s->side[i];
    }
  }
  return LMOC_SOLVED;
}

/* Whether each friction sticks or slides from there on; the rates of the springs' ends stand in `spare`. */
static int moves(const springs *s, lmoc_flag *limits) {
  int all = 1;
  for (int64_t i = 0; i < s->n; i++) {
    limits[s->own->which[i]] = limit_of(s, i, s->force[i] + s->own->impulse[i]);
    s->q[i] = s->spare->rate[s->own->which[i]];
  }
  onwards(s, limits);
  if (solve(s, LMOC_LOWER)) return 0;
  for (int64_t i = 0; i < s->n; i++) all &= s->unique[i];
  return all;
}

/* Changes of forces that rise at once to where one slides, for what moves them does not yield: those of a step of time
   that is too short for anything else to move. */
static int jump(const springs *s) {
  const int64_t n = s->n;
  double softest = 0, fastest = DBL_MIN, room = 0, *x = s->own->impulse, *b = s->own->rate, *values = s->low;
  for (int64_t i = 0; i < n; i++) {
    softest = fmax(softest, s->matrix[i*n + i]);
    fastest = fmax(fastest, fabs(s->q[i]));
    s->low[i] = s->lower[i] - s->force[i];
    s->high[i] = s->upper[i] - s->force[i];
    if (s->high[i] - s->low[i] < INFINITY) room = fmax(room, s->high[i] - s->low[i]);
  }
  for (int64_t i = 0; i < n; i++) s->q[i] *= INSTANT * softest / fastest * room;
  const int failed = solve(s, LMOC_LOWER);
  if (failed) return failed;
  int64_t m = 0, *free_ones = s->pinned;
  for (int64_t i = 0; i < n; i++) {
    if (s->side[i] == LMOC_FREE) free_ones[m++] = i;
    else x[i] = s->side[i] == LMOC_LOWER ? s->low[i] : s->high[i];
  }
  for (int64_t i = 0; i < m; i++) {
    const double *row = s->matrix + free_ones[i]*n;
    b[i] = 0;
    for (int64_t j = 0; j < n; j++) if (s->side[j] != LMOC_FREE) b[i] -= row[j] * x[j];
    for (int64_t j = 0; j < m; j++) s->u[i*m + j] = row[free_ones[j]];
  }
  lmoc_singular_values(m, m, s->u, s->v, values);
  lmoc_least_squares(m, s->u, s->v, values, DBL_EPSILON * (double)m, b, s->q);
  for (int64_t i = 0; i < m; i++) x[free_ones[i]] = s->q[i];
  return LMOC_SOLVED;
}

/* The changes of the forces. */
static int change(const springs *s, lmoc_flag *limits) {
  const size_t size = (size_t)s->n * sizeof(double);
  double *kept = s->v;
  int failed;
  if ((failed = give_way(s)) || (failed = shortly(s, 0))) return failed;
  for (int64_t i = 0; i < s->n; i++) s->scale[i] = fabs(s->force[i]) + (s->upper[i] < INFINITY ? s->upper[i] : 0);
  memcpy(kept, s->own->impulse, size);
  if (moves(s, limits)) memcpy(s->own->impulse, kept, size);
  else if ((failed = jump(s))) return failed;
  for (int64_t i = 0; i < s->n; i++) {
    double *x = s->own->impulse + i;
    if (fabs(*x) <= MOVED * s->scale[i]) *x = 0;
    limits[s->own->which[i]] = limit_of(s, i, s->force[i] + *x);
  }
  return LMOC_SOLVED;
}

static int judged(const springs *s, int status, lmoc_flag *laws) {
  if (status == LMOC_NO_SOLUTION) lmoc_contradicting(s->n, s->own->impulse, s->own->which, s->k->laws.count, laws);
  return status;
}

int lmoc_jenkins_relax(const lmoc_kinematics *k, const lmoc_flag *closed, const lmoc_flag *opening, const int64_t *direction,
                       lmoc_contact *now, lmoc_contact *spare, lmoc_impact *room, lmoc_flag *limits, double *lost,
                       lmoc_flag *laws) {
  springs s;
  int failed = make(k, now, spare, room, &s), moved = 0;
  if (failed || !s.n) return failed;
  for (int64_t i = 0; i < s.n; i++) {
    const int64_t law = room->which[i];
    s.released[i] = opening[law] || !closed[law];
    s.pinned[i] = opening[law] && k->laws.dry[law] ? -direction[law] : 0;
  }
  failed = judged(&s, change(&s, limits), laws);
  for (int64_t i = 0; i < s.n && !failed; i++) {
    double way = 0;
    for (int64_t j = 0; j < s.n; j++) way += s.matrix[i*s.n + j] * room->impulse[j];
    lost[room->which[i]] += fmax(0, -(s.force[i] + 0.5 * room->impulse[i]) * way);
    moved |= room->impulse[i] != 0;
  }
  free(s.matrix);
  if (failed || !moved || (failed = lmoc_behind(k, now, room, spare))) return failed;
  const lmoc_contact kept = *now;
  *now = *spare;
  *spare = kept;
  return LMOC_SOLVED;
}

int lmoc_jenkins_decide(const lmoc_kinematics *k, lmoc_contact *now, lmoc_contact *spare, lmoc_impact *room,
                        const lmoc_flag *limits, lmoc_settled *found) {
  springs s;
  int failed = make(k, now, spare, room, &s);
  if (failed || !s.n) return failed;
  for (int64_t i = 0; i < s.n; i++) {
    const int64_t law = room->which[i], onto = now->rate[law] < 0 ? -1 : 1;
    const int64_t sliding[] = {0, 1, -1, onto};
    found->direction[law] = k->laws.dry[law] ? sliding[limits[law]] : 0;
    found->closed[law] = found->implied[law] = 0;
  }
  failed = shortly(&s, found);
  if (!failed) {
    lmoc_part_of(spare, k->laws.count, room, s.matrix);
    onwards(&s, limits);
    for (int64_t i = 0; i < s.n; i++) {
      const lmoc_flag at = limits[room->which[i]];
      s.q[i] = spare->bias[room->which[i]];
      s.side[i] = at & LMOC_AT_UPPER ? LMOC_UPPER : at ? LMOC_LOWER : LMOC_FREE;
    }
    failed = lmoc_complementarity(s.n, s.matrix, s.q, s.low, s.high, room->impulse, room->rate, s.side, s.unique);
    failed = judged(&s, failed, found->laws);
  }
  for (int64_t i = 0; i < s.n && !failed; i++) {
    const int64_t law = room->which[i];
    found->closed[law] = s.side[i] == LMOC_FREE && limits[law] != (LMOC_AT_LOWER | LMOC_AT_UPPER);
    if (found->closed[law]) found->direction[law] = 0;
    found->push[law] = 0;
  }
  free(s.matrix);
  return failed;
}
