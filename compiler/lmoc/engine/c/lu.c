/* Sparse LU: factors on a fixed pattern and order of pivots, as KLU's refactor computes them (Davis and Palamadai
   Natarajan, ACM TOMS 37, 2010, Algorithm 907). When a pivot has become small beside its column, the order is reselected
   (`lu_order.c`). */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lu.h"

#define WEAK 1e-3 /* of its column: a pivot below is reselected */

lmoc_lu *lmoc_lu_new(int64_t n, const int32_t *start, const int32_t *rows) {
  lmoc_lu *f = calloc(1, sizeof *f);
  if (!f) return 0;
  const int64_t entries = start[n];
  int32_t *copied = malloc((n + 1 + entries) * sizeof(int32_t));
  f->n = n;
  f->start = copied;
  f->rows = copied ? copied + n + 1 : 0;
  f->a_start = calloc(n + 1, sizeof(int32_t));
  f->a_place = calloc(entries + 1, sizeof(int32_t));
  f->a_source = calloc(entries + 1, sizeof(int32_t));
  f->u_start = calloc(n + 1, sizeof(int32_t));
  f->l_start = calloc(n + 1, sizeof(int32_t));
  f->row = calloc(n + 1, sizeof(int32_t));
  f->column = calloc(n + 1, sizeof(int32_t));
  f->u = f->l = f->d = calloc(n + 1, sizeof(double));
  f->x = calloc(2*n + 1, sizeof(double));
  f->chosen = calloc(entries + 1, sizeof(double));
  if (!copied || !f->a_start || !f->a_place || !f->a_source || !f->u_start || !f->l_start || !f->row || !f->column ||
      !f->u || !f->x || !f->chosen) {
    lmoc_lu_free(f);
    return 0;
  }
  memcpy(copied, start, (n + 1) * sizeof(int32_t));
  memcpy(copied + n + 1, rows, entries * sizeof(int32_t));
  return f;
}

void lmoc_lu_free(lmoc_lu *f) {
  if (!f) return;
  void *owned[] = {(void *)f->start, f->a_start, f->a_place, f->a_source, f->u_start, f->u_place, f->l_start,
                   f->l_place, f->l_column, f->slot, f->row, f->column, f->u, f->x, f->chosen};
  for (size_t k = 0; k < sizeof owned / sizeof *owned; k++) free(owned[k]);
  free(f);
}

void lmoc_lu_forget(lmoc_lu *f) { f->ready = 0; }

/* Column k ends: its entries of L are divided by the pivot; whether that is large enough beside them. */
static inline int finish(const lmoc_lu *f, int64_t k) {
  const double d = f->d[k];
  double largest = fabs(d);
  for (int32_t g = f->l_start[k]; g < f->l_start[k + 1]; g++) {
    const double own = f->l[g];
    if (!(fabs(own) <= largest)) largest = fabs(own); /* a NaN stays */
    f->l[g] = own / d;
  }
  return fabs(d) >= WEAK * largest && d != 0;
}

/* The same operations in the same order from a list: of short columns, loops over each would mostly be begun and ended. */
static int by_list(const lmoc_lu *f, const double *values, double *determinant) {
  double *v = f->u, product = 1;
  const int32_t *o = f->operations;
  memset(v, 0, (size_t)(f->u_start[f->n] + f->l_start[f->n] + f->n) * sizeof(double));
  for (int32_t e = 0; e < f->a_start[f->n]; e++) v[f->slot[e]] += values[f->a_source[e]];
  for (int64_t k = 0; k < f->n; k++) {
    for (const int32_t *end = f->operations + f->end[k]; o < end; o += 3) v[o[0]] -= v[o[1]] * v[o[2]];
    if (!finish(f, k)) return LMOC_LU_SINGULAR;
    product *= f->d[k];
  }
  *determinant = product;
  return LMOC_LU_GOOD;
}

int lmoc_lu_refactor(const lmoc_lu *f, const double *values, double *determinant) {
  if (f->slot) return by_list(f, values, determinant);
  double *x = f->x, product = 1;
  for (int64_t k = 0; k < f->n; k++) {
    for (int32_t e = f->a_start[k]; e < f->a_start[k + 1]; e++) x[f->a_place[e]] += values[f->a_source[e]];
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++) {
      const int32_t j = f->u_place[e];
      const double y = x[j];
      f->u[e] = y;
      x[j] = 0;
      if (y != 0)
        for (int32_t g = f->l_start[j]; g < f->l_start[j + 1]; g++) x[f->l_place[g]] -= f->l[g] * y;
    }
    f->d[k] = x[k];
    x[k] = 0;
    for (int32_t g = f->l_start[k]; g < f->l_start[k + 1]; g++) {
      f->l[g] = x[f->l_place[g]];
      x[f->l_place[g]] = 0;
    }
    if (!finish(f, k)) {
      memset(f->x, 0, f->n * sizeof(double));
      return LMOC_LU_SINGULAR;
    }
    product *= f->d[k];
  }
  *determinant = product;
  return LMOC_LU_GOOD;
}

int lmoc_lu_factor(lmoc_lu *f, const double *values, double *determinant) {
  if (f->ready && lmoc_lu_refactor(f, values, determinant) == LMOC_LU_GOOD) return LMOC_LU_GOOD;
  *determinant = 0;
  for (int32_t k = 0; k < f->start[f->n]; k++)
    if (values[k] * 0 != 0) return LMOC_LU_SINGULAR; /* no numbers: keep the order that was good for numbers */
  const int found = lmoc_lu_choose(f, values);
  return found == LMOC_LU_GOOD ? lmoc_lu_refactor(f, values, determinant) : found;
}

void lmoc_lu_solve(const lmoc_lu *f, double *b) {
  double *y = f->x + f->n;
  for (int64_t k = 0; k < f->n; k++) y[k] = b[f->row[k]];
  for (int32_t g = 0; g < f->l_start[f->n]; g++) {
    const double v = y[f->l_column[g]];
    if (v != 0) y[f->l_place[g]] -= f->l[g] * v;
  }
  for (int64_t k = f->n - 1; k >= 0; k--) {
    const double v = y[k] / f->d[k];
    b[f->column[k]] = v;
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++) y[f->u_place[e]] -= f->u[e] * v;
  }
}
