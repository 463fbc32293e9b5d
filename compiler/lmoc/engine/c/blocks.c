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

#if LMOC_OF_LANES

/* Of lanes: the same operations in the same order, each lane with its own pivots; with no determinant. Zeros are skipped
   where `lmoc_dense_factor` skips them. */
LMOC_WIDEST static int64_t factorize(lmoc_block *m, double *a, int32_t *pivots) {
  const int64_t n = m->size;
  int64_t lost = 0;
  for (int64_t k = 0; k < n; k++) {
    LMOC_EACH_LANE {
      int64_t pivot = k;
      for (int64_t i = k + 1; i < n; i++)
        if (fabs(a[LMOC_AT(i*n + k) + l]) > fabs(a[LMOC_AT(pivot*n + k) + l])) pivot = i;
      pivots[LMOC_AT(k) + l] = (int32_t)pivot;
      for (int64_t j = 0; pivot != k && j < n; j++) {
        const double t = a[LMOC_AT(k*n + j) + l];
        a[LMOC_AT(k*n + j) + l] = a[LMOC_AT(pivot*n + j) + l];
        a[LMOC_AT(pivot*n + j) + l] = t;
      }
      const double own = a[LMOC_AT(k*n + k) + l];
      if (!(own != 0 && own * 0 == 0)) lost |= (int64_t)1 << l;
    }
    const double *own = a + LMOC_AT(k*n);
    for (int64_t i = k + 1; i < n; i++) {
      double *row = a + LMOC_AT(i*n), *f = row + LMOC_AT(k);
      LMOC_ROW(f, 0) /= LMOC_ROW(own, k);
      if (k == n - 2) LMOC_ROW(row, n - 1) -= LMOC_ROW(f, 0) * LMOC_ROW(own, n - 1);
      else for (int64_t j = LMOC_AT(k + 1); j < LMOC_AT(n); j += LMOC_LANES)
        LMOC_EACH_LANE row[j + l] = f[l] != 0 ? row[j + l] - f[l]*own[j + l] : row[j + l];
    }
  }
  return lost;
}

LMOC_WIDEST static void substitute(const lmoc_block *m, const double *a, const int32_t *pivots, double *b) {
  const int64_t n = m->size;
  for (int64_t k = 0; k < n; k++) {
    const int32_t *row = pivots + LMOC_AT(k);
    int32_t moved = 0;
    LMOC_EACH_LANE moved |= row[l] ^ (int32_t)k;
    if (moved) LMOC_EACH_LANE {
      double *other = b + LMOC_AT(row[l]) + l, *own = b + LMOC_AT(k) + l;
      const double t = *other;
      *other = *own;
      *own = t;
    }
  }
  for (int64_t k = 0; k < n; k++)
    for (int64_t j = 0; j < k; j++) LMOC_ROW(b, k) -= LMOC_ROW(a, k*n + j) * LMOC_ROW(b, j);
  for (int64_t k = n - 1; k >= 0; k--) {
    for (int64_t j = k + 1; j < n; j++) LMOC_ROW(b, k) -= LMOC_ROW(a, k*n + j) * LMOC_ROW(b, j);
    LMOC_ROW(b, k) /= LMOC_ROW(a, k*n + k);
  }
}

#else

static inline int64_t factorize(lmoc_block *m, double *a, int32_t *pivots) {
  double determinant;
  return !lmoc_block_factor(m, a, pivots, &determinant);
}

static inline void substitute(const lmoc_block *m, const double *a, const int32_t *pivots, double *b) {
  lmoc_block_solve(m, a, pivots, b);
}

#endif

void LMOC_NAME(lmoc_block_substitute)(const lmoc_block *m, int64_t instance, double *w, double *b) {
  substitute(m, lmoc_block_factors(m, instance, w), lmoc_block_pivots(m, instance), b);
}

/* Unknowns from their residuals at zero, from the factors of an instance; no numbers in lanes that have lost theirs. */
static inline void solve(const lmoc_block *m, int64_t instance, int64_t lost, const double *a, const int32_t *pivots,
                         double *b, double *w) {
  const int32_t *u = m->unknowns + instance*m->size, *r = m->residuals + instance*m->size;
  const int64_t all = ((int64_t)1 << LMOC_LANES) - 1;
  for (int64_t k = 0; k < m->size; k++) LMOC_ROW(b, k) = -LMOC_ROW(w, r[k]);
  if (lost != all) substitute(m, a, pivots, b);
  for (int64_t k = 0; k < m->size; k++) {
    LMOC_ROW(w, u[k]) = LMOC_ROW(b, k);
    if (lost) LMOC_EACH_LANE if ((lost >> l) & 1) w[LMOC_AT(u[k]) + l] = NAN;
  }
}

static void linear(lmoc_block *m, double *w) {
  double *a = w + LMOC_AT(m->a), *b = w + LMOC_AT(m->b);
  for (int64_t i = 0; i < m->instances; i++) {
    lmoc_block_fill(m, i, w, a);
    solve(m, i, factorize(m, a, m->pivots), a, m->pivots, b, w);
  }
}

/* The same with a matrix that depends on parameters only: `ready` is 1 when it has been factorized; one that cannot be
   has no numbers for factors. A dense block keeps the factors of all instances. */
static void constant(lmoc_block *m, double *w) {
  double *b = w + LMOC_AT(m->b);
  const int fresh = !m->ready;
  m->ready = 1;
  for (int64_t i = 0; i < m->instances; i++) {
    double *a = lmoc_block_factors(m, i, w);
    int32_t *pivots = lmoc_block_pivots(m, i);
    int64_t lost = 0;
    if (fresh) {
      lmoc_block_fill(m, i, w, a);
      lost = factorize(m, a, pivots);
    }
    LMOC_EACH_LANE {
      if ((lost >> l) & 1) a[l] = NAN;
      if (a[l] != a[l]) lost |= (int64_t)1 << l;
    }
    solve(m, i, lost, a, pivots, b, w);
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
  int64_t lost = 0;
  for (int64_t i = 0; i < m->instances; i++) {
    double *a = lmoc_block_factors(m, i, w);
    lmoc_block_fill(m, i, w, a);
    lost |= factorize(m, a, lmoc_block_pivots(m, i));
  }
  return (int)(lost * LMOC_FAILED);
}

#if LMOC_OF_LANES
const lmoc_blocks LMOC_NAME(lmoc_block_functions) = {
  .linear = linear, .constant = constant, .factor = factor, .rows = LMOC_NAME(lmoc_rows)
};
#else
const lmoc_blocks lmoc_block_functions = {linear,   lmoc_newton_begin, lmoc_newton_step, lmoc_newton_end,
                                          constant, implicit,          factor,           lmoc_rows};
#endif
