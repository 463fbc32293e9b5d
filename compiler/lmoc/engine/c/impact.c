/* Impacts, by a law for all of it at once.

   The rates r of the laws change by the impulses L through the Delassus matrix W of the whole constrained system,
   r+ = r- + W L. Newton's law with restitution asks of every law that touches

     0 <= L _|_ r+ + e min(r-, 0) >= 0,

   for all laws simultaneously (F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter
   8). With different e, or through friction, that can create energy (T. R. Kane, Stanford Mechanics Alumni Club
   Newsletter, 1984; C. Glocker, Multibody System Dynamics 29, 2013) or, for laws that depend on each other, contradict
   itself. Poisson's law then decides: a plastic impact compresses, and at least e times its impulses is given back.

   Friction of a contact takes part with |Lt| <= mu Ln: it stops the sliding if that is enough, and else gives all it can
   against it (Coulomb's law on impulses, J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics,
   1988). Its limits follow from the other impulses. */

#include "impact.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

static const double CREATED = 1e-12; /* share of the energy turned over beyond which energy gained counts as created */
enum { MOST_LIMITS = 12 };           /* limits of friction tried one after the other before `lmoc_with_cones` */

/* Impulses x and rates w, with room for the limits of friction and for what is tried. */
typedef struct {
  int64_t n;
  const double *delassus, *least;
  const lmoc_friction *friction;
  double *q, *x, *w, *lower, *upper, *right, *exact, *terms, *matrix, *vectors, *values;
  int64_t *side, *before;
  lmoc_flag *unique;
} impulses;

/* ------------------------------------------------------------------ with friction */

static double most_of(int64_t n, const double *x) {
  double most = 0;
  for (int64_t k = 0; k < n; k++) most = fmax(most, fabs(x[k]));
  return most;
}

static void limit(const impulses *s, const double *x) {
  const lmoc_friction *f = s->friction;
  for (int64_t a = 0; a < f->count; a++) {
    s->upper[f->rows[a]] = f->share[a] * x[f->normal[a]];
    s->lower[f->rows[a]] = -s->upper[f->rows[a]];
  }
}

/* The impulses with which everything is on its side. */
static void with_sides(const impulses *s) {
  const int64_t n = s->n;
  const lmoc_friction *f = s->friction;
  memset(s->matrix, 0, n * n * sizeof(double));
  for (int64_t i = 0; i < n; i++) {
    const int is_free = s->side[i] == LMOC_FREE;
    if (is_free) memcpy(s->matrix + i*n, s->delassus + i*n, n * sizeof(double));
    else s->matrix[i*n + i] = 1;
    s->right[i] = is_free ? -s->q[i] : s->side[i] == LMOC_LOWER ? s->least[i] : 0;
  }
  for (int64_t a = 0; a < f->count; a++) {
    const int64_t row = f->rows[a];
    if (s->side[row] == LMOC_FREE) continue;
    s->matrix[row*n + f->normal[a]] -= (s->side[row] == LMOC_LOWER ? -1 : 1) * f->share[a];
    s->right[row] = 0;
  }
  double *u = s->vectors + n * n;
  memcpy(u, s->matrix, n * n * sizeof(double));
  lmoc_singular_values(n, n, u, s->vectors, s->values);
  lmoc_least_squares(n, u, s->vectors, s->values, DBL_EPSILON * (double)n, s->right, s->exact);
}

/* Take the impulses with which everything is on its side; 0 where these are no solution. */
static int take_exact(const impulses *s) {
  const int64_t n = s->n;
  double *exact = s->exact, *w = s->values, missed = 0, slack = 0;
  with_sides(s);
  const double size = LMOC_NEGLIGIBLE * (most_of(n, exact) + most_of(n, s->x));
  for (int64_t k = 0; k < n; k++) {
    s->lower[k] = s->least[k];
    s->upper[k] = INFINITY;
  }
  limit(s, exact);
  for (int64_t i = 0; i < n; i++) {
    double terms = fabs(s->q[i]), sum = 0;
    for (int64_t j = 0; j < n; j++) {
      terms += fabs(s->delassus[i*n + j] * exact[j]);
      sum += s->matrix[i*n + j] * exact[j];
    }
    s->terms[i] = LMOC_NEGLIGIBLE * terms;
    slack = fmax(slack, s->terms[i]);
    missed = fmax(missed, fabs(sum - s->right[i]));
  }
  lmoc_affine(n, s->delassus, exact, s->q, w);
  if (!(missed <= fmax(size, slack))) return 0;
  for (int64_t k = 0; k < n; k++) {
    if (!(exact[k] >= s->lower[k] - size && exact[k] <= s->upper[k] + size)) return 0;
    if (s->side[k] == LMOC_LOWER && !(w[k] >= -s->terms[k])) return 0;
    if (s->side[k] == LMOC_UPPER && !(w[k] <= s->terms[k])) return 0;
  }
  for (int64_t k = 0; k < n; k++) {
    s->x[k] = exact[k];
    s->w[k] = s->side[k] == LMOC_FREE ? 0 : w[k];
  }
  return 1;
}

static int solve(const impulses *s) {
  return lmoc_complementarity(s->n, s->delassus, s->q, s->lower, s->upper, s->x, s->w, s->side, s->unique);
}

/* Where sides repeat, so that each friction either sticks or gives its share of its normal impulse, the impulses follow
   at once. Where none repeat, Lemke's algorithm decides. */
static int with_friction(const impulses *s) {
  const int64_t n = s->n;
  int found;
  for (int64_t a = 0; a < s->friction->count; a++) s->lower[s->friction->rows[a]] = s->upper[s->friction->rows[a]] = 0;
  for (int64_t k = 0; k < n; k++) s->side[k] = LMOC_LOWER;
  if ((found = solve(s))) return found;
  for (int64_t k = 0; k < n; k++) s->side[k] = LMOC_LOWER;
  for (int round = 0; round < MOST_LIMITS; round++) {
    memcpy(s->lower, s->least, n * sizeof(double));
    for (int64_t k = 0; k < n; k++) s->upper[k] = INFINITY;
    limit(s, s->x);
    memcpy(s->before, s->side, n * sizeof(int64_t));
    if ((found = solve(s))) return found;
    if (round && !memcmp(s->before, s->side, n * sizeof(int64_t)) && take_exact(s)) return LMOC_SOLVED;
  }
  for (int64_t k = 0; k < n; k++) s->upper[k] = INFINITY;
  memset(s->unique, 1, n);
  found = lmoc_with_cones(n, s->delassus, s->q, s->least, s->upper, s->friction, s->x, s->w, s->side);
  if (found == LMOC_SOLVED) take_exact(s);
  return found;
}

/* Impulses, at least some of the laws without friction; the limits of friction follow from the answer. */
static int impulses_of(impulses *s, const double *least, const int64_t *side) {
  s->least = least;
  for (int64_t k = 0; k < s->n; k++) {
    s->lower[k] = least[k];
    s->upper[k] = INFINITY;
    s->side[k] = side ? side[k] : LMOC_LOWER;
  }
  return s->friction->count ? with_friction(s) : solve(s);
}

/* ------------------------------------------------------------------ the laws of impact */

/* `wanted` (n,) gets what is given back of the rates. */
static int newton(impulses *s, const double *rate, const double *restitution, const int64_t *side, double *wanted,
                  double *least) {
  for (int64_t k = 0; k < s->n; k++) wanted[k] = restitution[k] * fmin(rate[k], 0);
  for (int64_t a = 0; a < s->friction->count; a++) wanted[s->friction->rows[a]] = 0;
  for (int64_t k = 0; k < s->n; k++) {
    s->q[k] = rate[k] + wanted[k];
    least[k] = 0;
  }
  const int found = impulses_of(s, least, side);
  for (int64_t k = 0; k < s->n && !found; k++) s->w[k] -= wanted[k];
  return found;
}

/* `least`: what is given back of the impulses. Laws that depend on each other would contradict each other by rounding of
   the rates behind the compression. */
static int poisson(impulses *s, const double *rate, const double *restitution, double *compression, double *least) {
  const int64_t n = s->n;
  lmoc_flag *unique = (lmoc_flag *)(s->before + n);
  int found;
  for (int64_t k = 0; k < n; k++) {
    s->q[k] = rate[k];
    least[k] = 0;
  }
  if ((found = impulses_of(s, least, 0))) return found;
  lmoc_slack(n, s->delassus, rate, s->x, s->terms);
  for (int64_t k = 0; k < n; k++) {
    compression[k] = s->x[k];
    least[k] = restitution[k] * s->x[k];
    s->q[k] = fabs(s->w[k]) <= s->terms[k] ? 0 : s->w[k];
    unique[k] = s->unique[k];
  }
  if ((found = impulses_of(s, least, 0))) return found;
  for (int64_t k = 0; k < n; k++) {
    s->x[k] += compression[k];
    s->unique[k] &= unique[k];
  }
  return LMOC_SOLVED;
}

/* Whether Newton's law creates energy. */
static int creates(const impulses *s, const double *rate, double *lost) {
  double sum = 0, turned = 0;
  for (int64_t k = 0; k < s->n; k++) {
    sum += lost[k] = -0.5 * s->x[k] * (rate[k] + s->w[k]);
    turned += fabs(s->x[k]) * (fabs(rate[k]) + fabs(s->w[k]));
  }
  return !(-sum <= CREATED * turned);
}

int lmoc_collide(int64_t n, const double *delassus, const double *rate, const double *restitution,
                 const lmoc_friction *friction, const int64_t *side, double *impulse, double *after, double *lost,
                 lmoc_flag *unique, int *law) {
  const int64_t square = friction->count ? n * n : 0;
  double *memory = malloc((3*square + 9*n + 1) * sizeof(double));
  int64_t *places = malloc(2*n * sizeof(int64_t) + n + 1);
  int found = LMOC_NO_MEMORY;
  if (memory && places) {
    double *m = memory + 3*square;
    impulses s = {n, delassus, 0, friction, m, impulse, after, m + n, m + 2*n, m + 3*n, m + 4*n, m + 5*n, memory,
                  memory + square, m + 6*n, places, places + n, unique};
    *law = LMOC_NEWTON;
    found = newton(&s, rate, restitution, side, m + 7*n, m + 8*n);
    if (found == LMOC_NO_SOLUTION || (found == LMOC_SOLVED && creates(&s, rate, lost))) {
      *law = LMOC_POISSON;
      found = poisson(&s, rate, restitution, m + 7*n, m + 8*n);
      creates(&s, rate, lost);
    }
  }
  free(memory);
  free(places);
  return found;
}
