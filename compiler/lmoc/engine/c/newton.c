/* Newton's method for many instances of one nonlinear block. */

#include "blocks.h"
#include "newton.h"

const lmoc_newton_rule lmoc_newton_rules[2] = {{0.5, 0.25, 10}, {0.95, 0.75, 60}};

void lmoc_newton_begin(lmoc_block *m, double *w) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  m->iteration = 0;
  for (int64_t k = 0; k < m->instances*m->size; k++) s.start[k] = w[m->unknowns[k]];
}

/* Whether the residuals vanish to rounding: the terms of row k are |a(k,j) u(j)|, and finite. */
static int vanishes(const lmoc_block *m, const double *a, const double *w, const int32_t *u, const int32_t *r, double *b) {
  for (int64_t k = 0; k < m->size; k++) b[k] = 0;
  if (m->start)
    for (int64_t j = 0; j < m->size; j++)
      for (int32_t e = m->start[j]; e < m->start[j + 1]; e++) b[m->rows[e]] += fabs(a[e] * w[u[j]]);
  else
    for (int64_t k = 0; k < m->size; k++)
      for (int64_t j = 0; j < m->size; j++) b[k] += fabs(a[k*m->size + j] * w[u[j]]);
  for (int64_t k = 0; k < m->size; k++)
    if (!(fabs(w[r[k]]) <= LMOC_ROUNDING * b[k] && b[k] < INFINITY)) return 0;
  return 1;
}

/* One correction of instance i: 1 where it is not solved by it, 0 where it is, -1 where it does not converge. */
static int correct(lmoc_block *m, const lmoc_newton_state *s, int64_t i, double *w) {
  const int64_t size = m->size;
  const int32_t *u = m->unknowns + i*size, *r = m->residuals + i*size;
  const double before = m->iteration ? s->before[i] : INFINITY, rate = lmoc_newton_rules[m->patient].rate;
  double *a = w + m->a, *b = w + m->b, length = 0, scale = 1;
  lmoc_block_fill(m, i, w, a);
  const int solved = vanishes(m, a, w, u, r, b);
  for (int64_t k = 0; k < size; k++) { b[k] = w[r[k]]; scale = fmax(scale, 1 + fabs(w[u[k]])); }
  const int good = lmoc_block_factor(m, a, m->pivots, &s->det[i]);
  if (good) lmoc_block_solve(m, a, m->pivots, b);
  for (int64_t k = 0; k < size; k++) length = lmoc_max(length, fabs(b[k]));
  if (!good) length = NAN;
  if (solved && !(length <= rate * before && length <= LMOC_LOOSE * scale)) {
    for (int64_t k = 0; k < size; k++) b[k] = 0;
    length = 0;
  }
  if (!(length * 0 == 0)) return -1;
  if (m->iteration == 0)
    for (int64_t k = 0; k < size; k++) s->target[i*size + k] = w[u[k]] - b[k];
  if (m->iteration && length > rate * before) { /* they stop shrinking: rounding is reached, or it fails */
    if (length > LMOC_LOOSE * scale) return -1;
    s->before[i] = -1;
    return 0;
  }
  for (int64_t k = 0; k < size; k++) w[u[k]] -= b[k];
  s->before[i] = LMOC_NEWTON_ARRIVED(length, before, scale) ? -1 : length;
  return s->before[i] >= 0;
}

/* One correction of every instance that is not solved. Returns how many are left, or -1 where one does not converge. */
int64_t lmoc_newton_step(lmoc_block *m, double *w) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  int64_t left = 0;
  for (int64_t i = 0; i < m->instances; i++) {
    if (m->iteration > 0 && s.before[i] < 0) continue;
    const int found = correct(m, &s, i, w);
    if (found < 0) return -1;
    left += found;
  }
  return left > 0 && m->iteration++ >= lmoc_newton_rules[m->patient].most ? -1 : left;
}

/* FAILED, or FAR where a solution is not where the first step pointed, near the one before (Deuflhard, Newton Methods
   for Nonlinear Problems, 2004, section 5.1). */
int lmoc_newton_end(lmoc_block *m, double *w, int64_t open) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  const int64_t size = m->size;
  if (open < 0) {
    for (int64_t k = 0; k < m->instances*size; k++) w[m->unknowns[k]] = NAN;
    return LMOC_FAILED;
  }
  for (int64_t i = 0; i < m->instances; i++) {
    double missed = 0, way = 0, scale = 1;
    for (int64_t k = i*size; k < (i + 1)*size; k++) {
      const double x = w[m->unknowns[k]], own = fabs(x - s.start[k]);
      missed = fmax(missed, fabs(x - s.target[k]));
      way = fmax(way, own);
      scale = fmax(scale, 1 + fabs(x));
      if (!(own <= LMOC_WAY * (1 + fabs(x)))) return LMOC_FAR;
    }
    if (!(missed <= lmoc_newton_rules[m->patient].near * way + LMOC_LOOSE * scale)) return LMOC_FAR;
  }
  return 0;
}
