/* Implicit blocks: their matrices, dense with row pivoting or sparse on a fixed order of pivots, and what is solved
   with them. */

#include "blocks.h"

#include "dense.h"

/* LU with row pivoting for two rows: the closure of a loop in the plane. */
static inline int pair_factor(double *a, int32_t *pivots, double *determinant) {
  const int lower = fabs(a[2]) > fabs(a[0]);
  const double p = lower ? a[2] : a[0], q = lower ? a[3] : a[1], r = lower ? a[0] : a[2], s = lower ? a[1] : a[3];
  pivots[0] = lower;
  pivots[1] = 1;
  a[0] = p;
  a[1] = q;
  a[2] = r / p;
  a[3] = s - a[2]*q;
  *determinant = (lower ? -p : p) * a[3];
  return p != 0 && p * 0 == 0 && a[3] != 0 && a[3] * 0 == 0;
}

static inline void pair_substitute(const double *a, const int32_t *pivots, double *b) {
  const double first = b[pivots[0]], second = b[1 - pivots[0]] - a[2]*first;
  b[1] = second / a[3];
  b[0] = (first - a[1]*b[1]) / a[0];
}

void lmoc_block_fill(const lmoc_block *m, int64_t instance, const double *w, double *a) {
  const int32_t *from = m->fill + instance*m->each;
  for (int64_t k = 0; k < m->each; k++) a[k] = w[from[k]];
}

int lmoc_block_factor(lmoc_block *m, double *a, int32_t *pivots, double *determinant) {
  if (!m->start && m->size == 2) return pair_factor(a, pivots, determinant);
  if (!m->start) return lmoc_dense_factor(m->size, a, pivots, determinant);
  return lmoc_lu_factor(m->lu, a, determinant) == LMOC_LU_GOOD;
}

void lmoc_block_solve(const lmoc_block *m, const double *a, const int32_t *pivots, double *b) {
  if (m->start) lmoc_lu_solve(m->lu, b);
  else if (m->size == 2) pair_substitute(a, pivots, b);
  else lmoc_dense_substitute(m->size, a, pivots, 1, b);
}

/* Unknowns from their residuals at zero; no numbers where the matrix is singular. */
static void linear(lmoc_block *m, double *w) {
  double *a = w + m->a, *b = w + m->b, determinant;
  for (int64_t i = 0; i < m->instances; i++) {
    const int32_t *u = m->unknowns + i*m->size, *r = m->residuals + i*m->size;
    lmoc_block_fill(m, i, w, a);
    for (int64_t k = 0; k < m->size; k++) b[k] = -w[r[k]];
    const int good = lmoc_block_factor(m, a, m->pivots, &determinant);
    if (good) lmoc_block_solve(m, a, m->pivots, b);
    for (int64_t k = 0; k < m->size; k++) w[u[k]] = good ? b[k] : NAN;
  }
}

/* The same with a matrix that depends on parameters only: `ready` is 1 when it has been factorized, -1 when it cannot be.
   A dense block keeps the factors of all instances. */
static void constant(lmoc_block *m, double *w) {
  double *b = w + m->b, determinant;
  const int fresh = !m->ready;
  if (fresh) m->ready = 1;
  for (int64_t i = 0; i < m->instances; i++) {
    const int32_t *u = m->unknowns + i*m->size, *r = m->residuals + i*m->size;
    double *a = w + m->a + i*m->each;
    int32_t *pivots = m->pivots + i*m->size;
    if (fresh) {
      lmoc_block_fill(m, i, w, a);
      if (!lmoc_block_factor(m, a, pivots, &determinant)) m->ready = -1;
    }
    for (int64_t k = 0; k < m->size; k++) b[k] = -w[r[k]];
    if (m->ready > 0) lmoc_block_solve(m, a, pivots, b);
    for (int64_t k = 0; k < m->size; k++) w[u[k]] = m->ready > 0 ? b[k] : NAN;
  }
}

/* x = -A^-1 B, the derivatives of the unknowns, column by column. */
static void implicit(lmoc_block *m, double *w) {
  double *a = w + m->a, *x = w + m->x, determinant;
  const int32_t *right = m->right;
  for (int64_t i = 0; i < m->instances; i++) {
    lmoc_block_fill(m, i, w, a);
    const int good = lmoc_block_factor(m, a, m->pivots, &determinant);
    for (int64_t j = 0; j < m->width; j++, x += m->size, right += m->size) {
      for (int64_t k = 0; k < m->size; k++) x[k] = w[right[k]];
      if (good) lmoc_block_solve(m, a, m->pivots, x);
      for (int64_t k = 0; k < m->size; k++) x[k] = good ? -x[k] : NAN;
    }
  }
}

/* Factors of all instances, to be used later; FAILED where one is singular. */
static int factor(lmoc_block *m, double *w) {
  int status = 0;
  double determinant;
  for (int64_t i = 0; i < m->instances; i++) {
    double *a = w + m->a + i*m->each;
    lmoc_block_fill(m, i, w, a);
    if (!lmoc_block_factor(m, a, m->pivots + i*m->size, &determinant)) status = LMOC_FAILED;
  }
  return status;
}

const lmoc_blocks lmoc_block_functions = {linear,   lmoc_newton_begin, lmoc_newton_step, lmoc_newton_end,
                                          constant, implicit,          factor};
