/* The next mode: which laws hold once everything at an instant is taken together.

   Laws that could be closed without a jump, a gap and its rate at zero, a sliding velocity at zero, are candidates.
   Their forces solve one complementarity problem on the level at which each is felt, dry friction between its limits.
   What reaches a sticking limit has its slipping limit from there on, and the problem is solved again; friction that
   ends at a limit slides. Several frictions on one motion share the load up to the sum of their limits. */

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "laws.h"

static const double IMPLIED = 1e-9;    /* what elimination leaves of the diagonal of a law that depends on others */
static const double ROUNDING = 1e-10;  /* by which a contact friction may pass its limit and still stick */
static const double RESTING = 1e-9;    /* share of its terms below which an acceleration is zero */
static const double HELD = 0.1;        /* of the acceleration by this share of its limit: if it is less, others hold
                                          friction at its limit */

/* An instant with memory for what is tried at it. */
typedef struct {
  int64_t n;
  const lmoc_laws *laws;
  const lmoc_levels *now;
  lmoc_settled *found;
  double *limit, *lower, *upper, *constant, *share, *terms;  /* (n,); of all laws */
  double *matrix, *q, *low, *high, *x, *w;                   /* of those that take part */
  int64_t *side, *pinned, *active, *order, *own_side;
  int64_t *sliders;                                          /* how many contacts have sliding friction, and which */
  lmoc_flag *stuck, *released, *resting, *spare, *own_unique;
} choice;

static int64_t sign(double x) { return (x > 0) - (x < 0); }

/* ------------------------------------------------------------------ forces */

/* Of sliding friction: constants, and shares of the normal forces. */
static void slide(const choice *c, const int64_t *direction) {
  int64_t count = 0;
  for (int64_t k = 0; k < c->n; k++) {
    const double force = direction[k] ? -(double)direction[k] * c->now->slip[k] : 0;
    c->constant[k] = c->laws->dry[k] ? force : 0;
    c->share[k] = c->laws->contact[k] ? force : 0;
    if (c->share[k] != 0) c->sliders[++count] = k;
  }
  c->sliders[0] = count;
}

/* The level of a law by the force of another one and what slides with it. */
static double coupling(const choice *c, int64_t law, int64_t other) {
  const double *row = c->now->delassus + law*c->n;
  double sum = row[other];
  for (int64_t i = 1; i <= c->sliders[0]; i++) {
    const int64_t k = c->sliders[i];
    if (c->laws->normal[k] == other) sum += row[k] * c->share[k];
  }
  return sum;
}

/* The problem of the laws in `active`, with sliding friction as it stands. */
static int64_t pose(const choice *c, const lmoc_flag *which) {
  int64_t count = 0;
  for (int64_t k = 0; k < c->n; k++)
    if (which[k]) c->active[count++] = k;
  for (int64_t i = 0; i < count; i++) {
    const int64_t law = c->active[i];
    double sum = 0;
    for (int64_t k = 0; k < c->n; k++) sum += c->now->delassus[law*c->n + k] * c->constant[k];
    c->q[i] = c->now->bias[law] + sum;
    c->low[i] = c->lower[law];
    c->high[i] = c->upper[law];
    c->own_side[i] = c->side[law];
    for (int64_t j = 0; j < count; j++) c->matrix[i*count + j] = coupling(c, law, c->active[j]);
  }
  return count;
}

static int contradiction(const choice *c, int64_t count) {
  lmoc_contradicting(count, c->x, c->active, c->n, c->found->laws);
  return LMOC_NO_SOLUTION;
}

/* Solve for the forces of the laws that are stuck; those of sliding friction follow from them. */
static int forces(const choice *c) {
  lmoc_settled *f = c->found;
  slide(c, f->direction);
  const int64_t count = pose(c, c->stuck);
  const int failed =
      lmoc_complementarity(count, c->matrix, c->q, c->low, c->high, c->x, c->w, c->own_side, c->own_unique);
  if (failed) return failed == LMOC_NO_SOLUTION ? contradiction(c, count) : failed;
  for (int64_t k = 0; k < c->n; k++) {
    f->force[k] = c->constant[k];
    f->unique[k] = 1;
    c->side[k] = LMOC_LOWER;
  }
  for (int64_t i = 0; i < count; i++) {
    f->force[c->active[i]] += c->x[i];
    f->unique[c->active[i]] = c->own_unique[i];
    c->side[c->active[i]] = c->own_side[i];
  }
  for (int64_t i = 1; i <= c->sliders[0]; i++) { /* of contacts that are not in `stuck` the normal force is 0 */
    const int64_t k = c->sliders[i], normal = c->laws->normal[k];
    if (c->stuck[normal]) f->force[k] += c->share[k] * f->force[normal];
  }
  lmoc_affine(c->n, c->now->delassus, f->force, c->now->bias, f->level);
  return LMOC_SOLVED;
}

/* The sizes of the terms whose sums the levels are. */
static void weigh(const choice *c) {
  for (int64_t i = 0; i < c->n; i++) {
    double sum = 0;
    for (int64_t j = 0; j < c->n; j++) sum += fabs(c->now->delassus[i*c->n + j] * c->found->force[j]);
    c->terms[i] = fabs(c->now->bias[i]) + sum;
  }
}

/* Bounds; equal ones for friction that is pinned to its limit. The limits of contact friction follow from other forces
   and are looked at afterwards; that of an open contact is 0. */
static void bound(const choice *c, const lmoc_flag *candidate) {
  const lmoc_laws *laws = c->laws;
  for (int64_t k = 0; k < c->n; k++) {
    const int airborne = laws->contact[k] && !candidate[laws->normal[k]];
    const int64_t pinned = c->released[k] ? 0 : c->pinned[k];
    c->upper[k] = laws->dry[k] ? c->limit[k] : airborne ? 0 : INFINITY;
    c->lower[k] = laws->complementary[k] ? 0 : -c->upper[k];
    if (pinned) c->lower[k] = c->upper[k] = -(double)pinned * fmin(c->limit[k], DBL_MAX);
  }
}

/* ------------------------------------------------------------------ laws that depend on others */

static int64_t append(const choice *c, int64_t count, int group) {
  const lmoc_settled *f = c->found;
  for (int64_t k = 0; k < c->n; k++) {
    const int friction = c->side[k] == LMOC_FREE ? 1 : 2;
    const int own = f->closed[k] ? c->laws->complementary[k] ? 0 : friction : c->resting[k] ? 3 : 4;
    if (own == group) c->order[count++] = k;
  }
  return count;
}

/* The closed and resting laws that depend on other closed ones, by Gaussian elimination.

   Complementarities come first, so that friction rather than these is found to depend on others, and friction at its
   limit rather than friction that can hold more. Only the sum of what dependent laws do is determined. An implied one
   keeps the force that it has, and the others do the rest until one of them reaches its limit. */
static int depend(const choice *c) {
  lmoc_settled *f = c->found;
  int64_t count = 0;
  for (int group = 0; group < 4; group++) count = append(c, count, group);
  double *work = malloc((count * count + count + 1) * sizeof(double)), *scale = work + count * count;
  if (!work) return LMOC_NO_MEMORY;
  slide(c, f->direction);
  for (int64_t i = 0; i < count; i++)
    for (int64_t j = 0; j < count; j++) work[i*count + j] = coupling(c, c->order[i], c->order[j]);
  for (int64_t i = 0; i < count; i++) scale[i] = sqrt(fmax(work[i*count + i], DBL_MIN));
  for (int64_t i = 0; i < count; i++)
    for (int64_t j = 0; j < count; j++) work[i*count + j] /= scale[i] * scale[j];
  for (int64_t k = 0; k < count; k++) {
    const double pivot = work[k*count + k];
    if (pivot <= IMPLIED) f->implied[c->order[k]] = 1;
    if (pivot <= IMPLIED || c->resting[c->order[k]]) continue; /* what rests begins to move, and holds nothing */
    for (int64_t i = k + 1; i < count; i++) {
      const double factor = work[i*count + k] / pivot;
      if (factor != 0) for (int64_t j = k; j < count; j++) work[i*count + j] -= factor * work[k*count + j];
    }
  }
  free(work);
  return LMOC_SOLVED;
}

/* ------------------------------------------------------------------ by pivoting */

/* Whether a friction gives way: beyond its sticking limit to the one of slipping, or of a contact beyond its cone. */
static int gives_way(const choice *c) {
  const lmoc_laws *laws = c->laws;
  const lmoc_levels *now = c->now;
  lmoc_settled *f = c->found;
  int weaker = 0, slips = 0;
  for (int64_t k = 0; k < c->n; k++) {
    const double alone = now->delassus[k*c->n + k] * LMOC_AT_LIMIT * c->limit[k]; /* were there nobody to hold more */
    c->spare[k] = laws->dry[k] && !c->released[k] && c->limit[k] > 0 && fabs(f->level[k]) <= HELD * alone;
    c->resting[k] = c->stuck[k] && laws->dry[k] && c->side[k] != LMOC_FREE && !c->released[k] && !c->spare[k];
    weaker |= c->resting[k] && (now->slip[k] < now->stick[k] || c->pinned[k]);
  }
  for (int64_t k = 0; k < c->n; k++) {
    if (!c->stuck[k] || !laws->contact[k]) continue;
    const double most = now->stick[k] * fmax(f->force[laws->normal[k]], 0);
    c->own_unique[k] = fabs(f->force[k]) > most * (1 + ROUNDING);
    slips |= c->own_unique[k];
  }
  if (!weaker && !slips) return 0;
  for (int64_t k = 0; k < c->n; k++) {
    c->released[k] |= c->resting[k];
    if (!c->stuck[k] || !laws->contact[k] || !c->own_unique[k]) continue;
    f->direction[k] = -sign(f->force[k]);
    c->stuck[k] = 0;
  }
  return 1;
}

/* What the forces say of each law. */
static int read(const choice *c, const lmoc_flag *candidate, const lmoc_flag *opening, double share) {
  lmoc_settled *f = c->found;
  int some = 0, failed = 0;
  weigh(c);
  for (int64_t k = 0; k < c->n; k++) {
    f->implied[k] = 0;
    f->closed[k] = c->stuck[k] && (c->side[k] == LMOC_FREE || c->spare[k]);
    if (c->stuck[k] && c->laws->dry[k] && !f->closed[k]) /* without a force, it slides as it is moved */
      f->direction[k] = f->force[k] != 0 ? -sign(f->force[k]) : f->level[k] < 0 ? -1 : 1;
    const int open = (candidate[k] || (opening && opening[k])) && !f->closed[k];
    c->resting[k] = open && fabs(f->level[k]) <= RESTING * c->terms[k] && c->laws->degree[k] == LMOC_POSITION;
    c->resting[k] |= f->direction[k] != 0 && candidate[k];
    some |= c->resting[k] || (f->closed[k] && (c->side[k] != LMOC_FREE || !f->unique[k]));
  }
  if (some && (failed = depend(c))) return failed;
  for (int64_t k = 0; k < c->n; k++) {
    /* where a motion turns, a force in its direction may do nothing for an instant: nobody holds it there */
    f->implied[k] &= f->closed[k] || fabs(f->level[k]) <= RESTING * c->terms[k];
    f->push[k] = !(f->closed[k] && f->implied[k]) ? 0 : c->side[k] == LMOC_FREE ? f->force[k] : f->force[k] / share;
  }
  return LMOC_SOLVED;
}

/* Block pivoting, with each friction beyond its limit set free. It begins where `side` is. */
static int by_pivoting(const choice *c, const lmoc_flag *candidate, const int64_t *sliding, const int64_t *at_limit,
                       const lmoc_flag *opening) {
  double share = 1;
  for (int64_t k = 0; k < c->n; k++) {
    c->stuck[k] = candidate[k];
    c->released[k] = 0;
    c->pinned[k] = candidate[k] && c->laws->dry[k] ? at_limit[k] : 0;  /* at the limit: do others hold more? */
    if (c->pinned[k]) share = 1 - LMOC_AT_LIMIT;
    c->found->direction[k] = candidate[k] || c->laws->complementary[k] ? 0 : sliding[k];
  }
  do {
    for (int64_t k = 0; k < c->n; k++)
      c->limit[k] = share * (c->released[k] ? fmin(c->now->slip[k], c->now->stick[k]) : c->now->stick[k]);
    bound(c, candidate);
    const int failed = forces(c);
    if (failed) return failed;
  } while (gives_way(c));
  return read(c, candidate, opening, share);
}

/* ------------------------------------------------------------------ by cones */

/* Contact friction among the candidates whose contact is one, too. */
static int rubs(const choice *c, const lmoc_flag *candidate, int64_t k) {
  return candidate[k] && c->laws->contact[k] && candidate[c->laws->normal[k]];
}

/* Whether contact friction that has been set free would slide against the direction of its force. */
static int slides_backwards(const choice *c, const lmoc_flag *candidate) {
  const lmoc_settled *f = c->found;
  weigh(c);
  for (int64_t k = 0; k < c->n; k++)
    if (rubs(c, candidate, k) && f->level[k] * (double)f->direction[k] < -RESTING * c->terms[k]) return 1;
  return 0;
}

/* The directions of sliding, with those of contact friction that cannot hold, by Lemke's algorithm. `lasting` are the
   candidates that do not slide then. */
static int by_cones(const choice *c, const lmoc_flag *candidate, const int64_t *sliding, int64_t *turned,
                    lmoc_flag *lasting) {
  int64_t *rows = c->order, *normal = c->order + c->n, many = 0;
  double *share = c->terms;
  memcpy(turned, sliding, c->n * sizeof(int64_t));
  memcpy(lasting, candidate, c->n);
  memcpy(c->limit, c->now->stick, c->n * sizeof(double));
  memset(c->pinned, 0, c->n * sizeof(int64_t));
  bound(c, candidate);
  slide(c, sliding);
  const int64_t count = pose(c, candidate);
  for (int64_t i = 0; i < count; i++) {
    const int64_t law = c->active[i];
    if (!rubs(c, candidate, law)) continue;
    rows[many] = i;
    share[many] = c->now->stick[law];
    for (normal[many] = 0; c->active[normal[many]] != c->laws->normal[law];) normal[many]++;
    many++;
  }
  const lmoc_friction friction = {many, rows, normal, share};
  const int failed = lmoc_with_cones(count, c->matrix, c->q, c->low, c->high, &friction, c->x, c->w, c->own_side);
  if (failed) return failed == LMOC_NO_SOLUTION ? contradiction(c, count) : failed;
  for (int64_t i = 0; i < count; i++) c->side[c->active[i]] = c->own_side[i]; /* that of a contact need not be unique */
  for (int64_t a = 0; a < many; a++) {
    const int64_t law = c->active[rows[a]];
    if (c->own_side[rows[a]] != LMOC_FREE) turned[law] = -c->own_side[rows[a]];
    lasting[law] = turned[law] == sliding[law];
  }
  return LMOC_SOLVED;
}

static int chosen(const choice *c, const lmoc_flag *closed, const lmoc_flag *candidate, const int64_t *sliding,
                  const int64_t *at_limit, const lmoc_flag *opening, int64_t *turned, lmoc_flag *lasting) {
  int rubbing = 0;
  for (int64_t k = 0; k < c->n; k++) {
    c->side[k] = closed[k] || candidate[k] ? LMOC_FREE : LMOC_LOWER;
    rubbing |= rubs(c, candidate, k);
  }
  int failed = by_pivoting(c, candidate, sliding, at_limit, opening);
  if (failed == LMOC_NO_MEMORY || !rubbing || (!failed && !slides_backwards(c, candidate))) return failed;
  if ((failed = by_cones(c, candidate, sliding, turned, lasting))) return failed;
  return by_pivoting(c, lasting, turned, at_limit, opening);
}

/* ------------------------------------------------------------------ all of it */

double lmoc_mode_input(const lmoc_settled *mode, int64_t laws, int64_t which) {
  const int64_t k = which % laws;
  if (which < laws) return mode->closed[k] && !mode->implied[k];
  return which < 2*laws ? mode->push[k] : (double)mode->direction[k];
}

/* No law is closed: forces are those of sliding friction. */
static int all_open(const choice *c, const int64_t *sliding) {
  lmoc_settled *f = c->found;
  for (int64_t k = 0; k < c->n; k++) {
    f->direction[k] = c->laws->complementary[k] ? 0 : sliding[k];
    f->closed[k] = f->implied[k] = 0;
    f->unique[k] = 1;
    f->push[k] = 0;
  }
  slide(c, f->direction);
  memcpy(f->force, c->constant, c->n * sizeof(double));
  lmoc_affine(c->n, c->now->delassus, f->force, c->now->bias, f->level);
  return LMOC_SOLVED;
}

int lmoc_settle(const lmoc_laws *laws, const lmoc_levels *now, const lmoc_flag *closed, const lmoc_flag *candidate,
                const int64_t *sliding, const int64_t *at_limit, const lmoc_flag *opening, lmoc_settled *found) {
  const int64_t n = laws->count;
  double *m = malloc((n * n + 11*n + 1) * sizeof(double));
  int64_t *i = malloc((8*n + 1) * sizeof(int64_t));
  lmoc_flag *f = malloc(6*n + 1);
  int some = 0, failed = LMOC_NO_MEMORY;
  for (int64_t k = 0; k < n; k++) some |= candidate[k] || (opening && opening[k]);
  if (m && i && f) {
    const choice c = {n, laws, now, found, m, m + n, m + 2*n, m + 3*n, m + 4*n, m + 5*n, m + 11*n, m + 6*n, m + 7*n,
                      m + 8*n, m + 9*n, m + 10*n, i, i + n, i + 2*n, i + 3*n, i + 5*n, i + 7*n, f, f + n, f + 2*n, f + 3*n,
                      f + 4*n};
    failed = some ? chosen(&c, closed, candidate, sliding, at_limit, opening, i + 6*n, f + 5*n) : all_open(&c, sliding);
  }
  free(m);
  free(i);
  free(f);
  return failed;
}
