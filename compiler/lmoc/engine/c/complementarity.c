/* Linear complementarity problems with bounds, by block principal pivoting.

   The force of a string has the bounds (0, inf), stuck friction (-limit, limit). Exchanging all components that violate
   their conditions at once takes a handful of factorizations, whatever the number of components (J. J. Judice and F. M.
   Pires, A block principal pivoting algorithm for large-scale strictly monotone linear complementarity problems,
   Computers & Operations Research 21, 1994). Should the number of violations stop falling, one component at a time is
   exchanged, the last in order, which ends for every P-matrix (K. G. Murty, Note on a Bard-type scheme, Opsearch 11,
   1974).

   Constraints that depend on each other make M only semidefinite: w is then unique and x is not. The proximal point
   method (R. T. Rockafellar, SIAM J. Control Optim. 14, 1976) turns that into a few problems with M + eps D, each warm-
   started from the one before: where a solution exists the iterates converge to one at the rate eps, and where none
   exists they grow without bound. */

#include "complementarity.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

static const double PROXIMAL = 1e-6;   /* eps, as a share of the diagonal */
static const double DEPENDENT = 1e-11; /* singular values below this share of the largest are of dependent constraints */
static const double ROUNDING = 1e-14;  /* ... violations below this share of the largest terms of all count as none */
static const double STAYS = 1e-8;      /* entries of null vectors below it are rounding */
static const double TAKES_PART = 1e-3; /* of the largest iterate: below it a component takes no part in a contradiction */
enum {
  MOST_PROXIMAL = 8, /* steps; the error falls by eps in each, so that a solvable problem takes two or three */
  APART_FROM = 12,   /* components from which on it is looked whether a problem falls into several */
  PATIENCE = 8       /* block exchanges without fewer violations before components are exchanged one at a time */
};

/* A problem with its memory. */
typedef struct {
  int64_t n;
  const double *matrix, *q, *lower, *upper;
  double *x, *w, *slack, *diagonal;
  int64_t *side;
} problem;

typedef struct {
  double *shifted, *q, *scaled, *inverse, *vectors, *values, *scale, *right, *change;
  int64_t *free, *violated;
  int32_t *pivots;
} scratch;

void lmoc_affine(int64_t n, const double *matrix, const double *x, const double *q, double *y) {
  for (int64_t i = 0; i < n; i++) {
    double sum = 0;
    for (int64_t j = 0; j < n; j++) sum += matrix[i*n + j] * x[j];
    y[i] = sum + q[i];
  }
}

void lmoc_slack(int64_t n, const double *matrix, const double *q, const double *x, double *slack) {
  double most = 0;
  for (int64_t i = 0; i < n; i++) {
    double sum = 0;
    for (int64_t j = 0; j < n; j++) sum += fabs(matrix[i*n + j] * x[j]);
    slack[i] = sum + fabs(q[i]);
    most = slack[i] > most || slack[i] != slack[i] ? slack[i] : most;
  }
  for (int64_t i = 0; i < n; i++) slack[i] = LMOC_NEGLIGIBLE * slack[i] + ROUNDING * most;
}

/* ------------------------------------------------------------------ one P-matrix */

static int is_violated(const problem *p, int64_t k) {
  const double x = p->x[k], w = p->w[k], beyond = p->slack[k] / p->diagonal[k];
  if (p->side[k] == LMOC_FREE) return x < p->lower[k] - beyond || x > p->upper[k] + beyond;
  return p->lower[k] < p->upper[k] && (p->side[k] == LMOC_LOWER ? w < -p->slack[k] : w > p->slack[k]);
}

static int64_t violated(const problem *p, int64_t *found) {
  int64_t count = 0;
  for (int64_t k = 0; k < p->n; k++)
    if (is_violated(p, k)) found[count++] = k;
  return count;
}

static int64_t free_ones(const problem *p, int64_t *found) {
  int64_t count = 0;
  for (int64_t k = 0; k < p->n; k++)
    if (p->side[k] == LMOC_FREE) found[count++] = k;
  return count;
}

static void take_part(int64_t n, const double *matrix, int64_t count, const int64_t *which, double *part) {
  for (int64_t i = 0; i < count; i++)
    for (int64_t j = 0; j < count; j++) part[i*count + j] = matrix[which[i]*n + which[j]];
}

/* The row of the free component of M x + q. */
static double row_of(const problem *p, int64_t k) {
  double sum = 0;
  for (int64_t j = 0; j < p->n; j++) sum += p->matrix[k*p->n + j] * p->x[j];
  return sum + p->q[k];
}

/* x with its components at their bounds or, where they are free, such that w = 0. */
static int to_point(const problem *p, const scratch *s) {
  const int64_t count = free_ones(p, s->free);
  double determinant;
  for (int64_t k = 0; k < p->n; k++)
    p->x[k] = p->side[k] == LMOC_LOWER ? p->lower[k] : p->side[k] == LMOC_UPPER ? p->upper[k] : 0;
  if (!count) return 1;
  for (int64_t i = 0; i < count; i++) s->right[i] = -row_of(p, s->free[i]);
  take_part(p->n, p->matrix, count, s->free, s->scaled);
  if (!lmoc_dense_factor(count, s->scaled, s->pivots, &determinant)) return 0;
  lmoc_dense_substitute(count, s->scaled, s->pivots, 1, s->right);
  for (int64_t i = 0; i < count; i++) p->x[s->free[i]] = s->right[i];
  return 1;
}

static void to_finite_bounds(const problem *p) {
  for (int64_t k = 0; k < p->n; k++) {
    const int64_t side = p->side[k];
    if (p->lower[k] == p->upper[k]) p->side[k] = LMOC_LOWER;
    else if (side != LMOC_FREE && isinf(side == LMOC_LOWER ? p->lower[k] : p->upper[k])) p->side[k] = LMOC_FREE;
  }
}

/* Solve a problem whose matrix is a P-matrix. */
static int pivot(const problem *p, const scratch *s) {
  int64_t fewest = p->n + 1, patience = PATIENCE;
  to_finite_bounds(p);
  for (int64_t round = 0; round < 100 + 2000*p->n; round++) {
    if (!to_point(p, s)) return LMOC_NO_SOLUTION;
    lmoc_affine(p->n, p->matrix, p->x, p->q, p->w);
    lmoc_slack(p->n, p->matrix, p->q, p->x, p->slack);
    int64_t count = violated(p, s->violated);
    const int64_t *which = s->violated;
    if (!count) return LMOC_SOLVED;
    if (count < fewest) {
      fewest = count;
      patience = PATIENCE;
    } else if (patience) patience--;
    else {
      which += count - 1;
      count = 1;
    }
    for (int64_t i = 0; i < count; i++) {
      const int64_t k = which[i];
      p->side[k] = p->side[k] != LMOC_FREE ? LMOC_FREE : p->x[k] < p->lower[k] ? LMOC_LOWER : LMOC_UPPER;
    }
  }
  return LMOC_NO_SOLUTION;
}

/* ------------------------------------------------------------------ semidefinite ones */

/* The part of the free components, with a diagonal of 1 where it is positive, as friction that slides need not leave
   it. */
static void take_scaled(const problem *p, const scratch *s, int64_t count) {
  take_part(p->n, p->matrix, count, s->free, s->scaled);
  for (int64_t i = 0; i < count; i++) {
    double size = s->scaled[i*count + i];
    for (int64_t j = 0; j < count && !(s->scaled[i*count + i] > 0); j++) size = fmax(size, fabs(s->scaled[i*count + j]));
    s->scale[i] = size > 0 ? 1 / sqrt(size) : 1;
  }
  for (int64_t i = 0; i < count; i++)
    for (int64_t j = 0; j < count; j++) s->scaled[i*count + j] *= s->scale[i] * s->scale[j];
}

/* Move x to the solution of the unshifted equations w = 0 of the free components that is nearest to it. 0 where these
   depend on each other: singular values and vectors tell how. */
static int polish(const problem *p, const scratch *s, int64_t count) {
  take_scaled(p, s, count);
  const int regular = lmoc_dense_inverse(count, s->scaled, s->pivots, 1 / DEPENDENT, s->inverse);
  if (!regular) {
    take_scaled(p, s, count);
    lmoc_singular_values(count, count, s->scaled, s->vectors, s->values);
  }
  for (int round = 0; round < 2; round++) { /* the second one refines */
    for (int64_t i = 0; i < count; i++) s->right[i] = s->scale[i] * row_of(p, s->free[i]);
    if (regular) {
      memset(s->change, 0, count * sizeof(double));
      lmoc_affine(count, s->inverse, s->right, s->change, s->change);
    } else lmoc_least_squares(count, s->scaled, s->vectors, s->values, DEPENDENT, s->right, s->change);
    for (int64_t i = 0; i < count; i++) p->x[s->free[i]] -= s->scale[i] * s->change[i];
  }
  return regular;
}

/* Which components do not change along the null space of the free part. */
static void determine(const problem *p, const scratch *s, int64_t count, int regular, lmoc_flag *unique) {
  double most = DBL_MIN;
  memset(unique, 1, p->n);
  if (regular) return;
  for (int64_t j = 0; j < count; j++) most = fmax(most, s->values[j]);
  for (int64_t j = 0; j < count; j++)
    for (int64_t i = 0; i < count && s->values[j] <= DEPENDENT * most; i++)
      if (!(fabs(s->vectors[i*count + j]) < STAYS)) unique[s->free[i]] = 0;
}

/* Whether x solves the unshifted problem; w is that of x. */
static int is_solved(const problem *p) {
  lmoc_affine(p->n, p->matrix, p->x, p->q, p->w);
  lmoc_slack(p->n, p->matrix, p->q, p->x, p->slack);
  for (int64_t k = 0; k < p->n; k++)
    if (is_violated(p, k) || (p->side[k] == LMOC_FREE && !(fabs(p->w[k]) <= p->slack[k]))) return 0;
  return 1;
}

static double clipped(double x, double lower, double upper) { return x < lower ? lower : x > upper ? upper : x; }

static int by_proximal_points(const problem *p, const scratch *s, double *own, lmoc_flag *unique) {
  const int64_t n = p->n;
  problem shifted = *p;
  double most = 0;
  shifted.matrix = s->shifted;
  shifted.q = s->q;
  shifted.diagonal = own;
  memcpy(s->shifted, p->matrix, n * n * sizeof(double));
  for (int64_t k = 0; k < n; k++) most = fmax(most, p->matrix[k*n + k]);
  for (int64_t k = 0; k < n; k++) {
    const double diagonal = p->matrix[k*n + k];
    p->diagonal[k] = diagonal > 0 ? diagonal : most > 0 ? most : 1;
    own[k] = s->shifted[k*n + k] += PROXIMAL * p->diagonal[k];
    p->x[k] = clipped(0, p->lower[k], p->upper[k]);
  }
  for (int step = 0; step < MOST_PROXIMAL; step++) {
    for (int64_t k = 0; k < n; k++) s->q[k] = p->q[k] - PROXIMAL * p->diagonal[k] * p->x[k];
    if (pivot(&shifted, s)) return LMOC_NO_SOLUTION;
    const int64_t count = free_ones(p, s->free);
    const int regular = polish(p, s, count);
    if (!is_solved(p)) continue;
    for (int64_t k = 0; k < n; k++) {
      if (p->side[k] == LMOC_FREE) p->w[k] = 0;
      p->x[k] = clipped(p->x[k], p->lower[k], p->upper[k]);
    }
    determine(p, s, count, regular, unique);
    return LMOC_SOLVED;
  }
  return LMOC_NO_SOLUTION;
}

/* A problem that is one. */
static int whole(problem p, lmoc_flag *unique) {
  const int64_t n = p.n, square = n * n;
  double *memory = malloc((4*square + 9*n) * sizeof(double));
  int64_t *places = malloc((2*sizeof(int64_t) + sizeof(int32_t)) * n);
  int found = LMOC_NO_MEMORY;
  if (memory && places) {
    double *m = memory + 4*square;
    const scratch s = {memory, m, memory + square, memory + 2*square, memory + 3*square, m + n, m + 2*n, m + 3*n,
                       m + 4*n, places, places + n, (int32_t *)(places + 2*n)};
    p.slack = m + 5*n;
    p.diagonal = m + 6*n;
    found = by_proximal_points(&p, &s, m + 7*n, unique);
  }
  free(memory);
  free(places);
  return found;
}

/* One component, which stays on its side where both would do. */
static void alone(double slope, double q, double lower, double upper, double *x, double *w, int64_t *side) {
  const double zero = -q / slope, rounding = 2 * (LMOC_NEGLIGIBLE + ROUNDING) * fabs(zero);
  const double beyond = *side == LMOC_FREE ? rounding : -rounding;
  const int at_bound = *side != LMOC_FREE && (zero == lower || zero == upper);
  if (lower < upper && lower - beyond <= zero && zero <= upper + beyond && !at_bound) {
    *x = clipped(zero, lower, upper);
    *side = LMOC_FREE;
    *w = 0;
  } else {
    *side = zero <= lower + rounding || lower == upper ? LMOC_LOWER : LMOC_UPPER;
    *x = *side == LMOC_LOWER ? lower : upper;
    *w = slope * *x + q;
  }
}

/* ------------------------------------------------------------------ several that have nothing to do with each other */

int64_t lmoc_first_of(int64_t *parent, int64_t one) {
  while (parent[one] != one) one = parent[one] = parent[parent[one]];
  return one;
}

void lmoc_join(int64_t *parent, int64_t one, int64_t other) {
  one = lmoc_first_of(parent, one);
  other = lmoc_first_of(parent, other);
  parent[one > other ? one : other] = one > other ? other : one;
}

static int coupled(problem p, lmoc_flag *unique) {
  if (p.n > 1 || !(p.matrix[0] > 0)) return whole(p, unique);
  alone(p.matrix[0], p.q[0], p.lower[0], p.upper[0], p.x, p.w, p.side);
  unique[0] = 1;
  return LMOC_SOLVED;
}

/* Solve for the components of a part, `which`, with memory for one as large as the whole. */
static int part_of(const problem *p, int64_t count, const int64_t *which, double *m, int64_t *side, lmoc_flag *unique,
                   lmoc_flag *all) {
  const int64_t n = p->n;
  double *given[] = {m, m + n, m + 2*n}, *x = m + 3*n, *w = m + 4*n, *matrix = m + 5*n;
  const double *from[] = {p->q, p->lower, p->upper};
  for (int64_t i = 0; i < count; i++) {
    for (int j = 0; j < 3; j++) given[j][i] = from[j][which[i]];
    side[i] = p->side[which[i]];
  }
  take_part(n, p->matrix, count, which, matrix);
  const problem own = {count, matrix, given[0], given[1], given[2], x, w, 0, 0, side};
  const int found = coupled(own, unique);
  if (found == LMOC_NO_SOLUTION) memset(p->x, 0, n * sizeof(double));
  for (int64_t i = 0; i < count; i++) {
    p->x[which[i]] = x[i];
    p->w[which[i]] = w[i];
    p->side[which[i]] = side[i];
    all[which[i]] = unique[i];
  }
  return found;
}

static int part_by_part(const problem *p, lmoc_flag *unique) {
  const int64_t n = p->n;
  double *memory = malloc((n * n + 5*n) * sizeof(double));
  int64_t *places = malloc(3*n * sizeof(int64_t) + n), *parent = places, *which = parent + n;
  int found = memory && places ? LMOC_SOLVED : LMOC_NO_MEMORY;
  for (int64_t k = 0; k < n && !found; k++) parent[k] = k;
  for (int64_t i = 0; i < n && !found; i++)
    for (int64_t j = 0; j < n; j++)
      if (p->matrix[i*n + j] != 0) lmoc_join(parent, i, j);
  for (int64_t first = 0; first < n && !found; first++) {
    int64_t count = 0;
    for (int64_t k = first; k < n; k++)
      if (lmoc_first_of(parent, k) == first) which[count++] = k;
    if (count) found = part_of(p, count, which, memory, which + n, (lmoc_flag *)(which + 2*n), unique);
  }
  free(memory);
  free(places);
  return found;
}

int lmoc_complementarity(int64_t n, const double *matrix, const double *q, const double *lower, const double *upper,
                         double *x, double *w, int64_t *side, lmoc_flag *unique) {
  const problem p = {n, matrix, q, lower, upper, x, w, 0, 0, side};
  if (!n) return LMOC_SOLVED;
  return n < APART_FROM ? coupled(p, unique) : part_by_part(&p, unique);
}

void lmoc_contradicting(int64_t n, const double *x, const int64_t *which, int64_t all, lmoc_flag *out) {
  double most = 0;
  for (int64_t i = 0; i < n; i++) most = fmax(most, fabs(x[i]));
  memset(out, 0, (size_t)all);
  for (int64_t i = 0; i < n; i++) out[which[i]] = !(fabs(x[i]) < TAKES_PART * most);
}
