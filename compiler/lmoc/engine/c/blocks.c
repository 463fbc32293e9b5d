/* Implicit blocks: their matrices, dense with row pivoting or sparse on a fixed order of pivots, and what is solved
   with them. */

#include "blocks.h"

#include "dense.h"

#if !LMOC_OF_LANES

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

#endif

/* Unknowns from their residuals at zero, from the factors of an instance; no numbers where there are none. */
static inline void solve(const lmoc_block *m, int64_t instance, const double *a, const int32_t *pivots, double *b,
                         double *w) {
  const int32_t *u = m->unknowns + instance*m->size, *r = m->residuals + instance*m->size;
  if (a) {
    for (int64_t k = 0; k < m->size; k++) b[k] = -w[LMOC_AT(r[k])];
    lmoc_block_solve(m, a, pivots, b);
  }
  for (int64_t k = 0; k < m->size; k++) w[LMOC_AT(u[k])] = a ? b[k] : NAN;
}

static void linear(lmoc_block *m, double *w) {
  double *a = w + LMOC_AT(m->a), *b = w + LMOC_AT(m->b), determinant;
  for (int64_t i = 0; i < m->instances; i++)
    LMOC_EACH_LANE {
      lmoc_block_fill(m, i, w + l, a);
      solve(m, i, lmoc_block_factor(m, a, m->pivots, &determinant) ? a : 0, m->pivots, b, w + l);
    }
}

/* The same with a matrix that depends on parameters only: `ready` is 1 when it has been factorized; one that cannot be
   has no numbers for factors. A dense block keeps the factors of all instances. */
static void constant(lmoc_block *m, double *w) {
  double *b = w + LMOC_AT(m->b), determinant;
  const int fresh = !m->ready;
  m->ready = 1;
  for (int64_t i = 0; i < m->instances; i++)
    LMOC_EACH_LANE {
      double *a = lmoc_block_factors(m, i, l, w);
      int32_t *pivots = lmoc_block_pivots(m, i, l);
      if (fresh) {
        lmoc_block_fill(m, i, w + l, a);
        if (!lmoc_block_factor(m, a, pivots, &determinant)) a[0] = NAN;
      }
      solve(m, i, a[0] == a[0] ? a : 0, pivots, b, w + l);
    }
}

#if !LMOC_OF_LANES

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

#endif

/* Factors of all instances, to be used later; FAILED where one is singular, in the bit of its lane. */
static int factor(lmoc_block *m, double *w) {
  int status = 0;
  double determinant;
  for (int64_t i = 0; i < m->instances; i++)
    LMOC_EACH_LANE {
      double *a = lmoc_block_factors(m, i, l, w);
      lmoc_block_fill(m, i, w + l, a);
      if (!lmoc_block_factor(m, a, lmoc_block_pivots(m, i, l), &determinant)) status |= LMOC_FAILED << l;
    }
  return status;
}

#if LMOC_OF_LANES
const lmoc_blocks LMOC_NAME(lmoc_block_functions) = {.linear = linear, .constant = constant, .factor = factor};
#else
const lmoc_blocks lmoc_block_functions = {linear,   lmoc_newton_begin, lmoc_newton_step, lmoc_newton_end,
                                          constant, implicit,          factor};
#endif
