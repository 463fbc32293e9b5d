/* Sparse LU factors on a fixed pattern and order of pivots. */

#ifndef LMOC_LU_H
#define LMOC_LU_H

#include <stdint.h>

/* The matrix is given by columns (`start`, `rows`); everything else is by columns in the order of the pivots:
   its entries by `a_place` (the pivot in whose row they stand) and `a_source` (where they are among the values),
   U above and L below the diagonal, and the diagonal `d`: one after the other in one array, which begins with `u`. `x` is
   work, zero between two calls; `chosen` are the values for which the order has been chosen: it comes back with them.

   Where columns are short all operations are listed as well: `slot` says where in that array an entry of the matrix
   belongs, and each operation is three places in it, `v[to] -= v[left]*v[right]`; those up to column k end at `end[k]`. */
typedef struct lmoc_lu {
  int64_t n, ready;
  const int32_t *start, *rows;
  int32_t *a_start, *a_place, *a_source, *u_start, *u_place, *l_start, *l_place, *l_column, *row, *column;
  int32_t *slot, *end, *operations; /* `slot` owns all three; 0 where nothing is listed */
  double *u, *l, *d, *x, *chosen;
} lmoc_lu;

enum { LMOC_LU_SINGULAR = 0, LMOC_LU_GOOD = 1, LMOC_LU_NO_MEMORY = -1 };

/* The pattern is copied; 0 where there is no memory. */
lmoc_lu *lmoc_lu_new(int64_t n, const int32_t *start, const int32_t *rows);
void lmoc_lu_free(lmoc_lu *f);

/* Have pivots reselected for the next values. */
void lmoc_lu_forget(lmoc_lu *f);

/* Choose the order of pivots for these values. */
int lmoc_lu_choose(lmoc_lu *f, const double *values);

/* Factors on the pattern and order at hand; SINGULAR where a pivot is too small beside its column. */
int lmoc_lu_refactor(const lmoc_lu *f, const double *values, double *determinant);

/* Factors: on the order of pivots at hand where that is good, else on a new one. */
int lmoc_lu_factor(lmoc_lu *f, const double *values, double *determinant);

/* b := A^-1 b with the last factors. */
void lmoc_lu_solve(const lmoc_lu *f, double *b);

#endif
