/* Dense matrices, by rows: small ones, and those that may be singular. */

#ifndef LMOC_DENSE_H
#define LMOC_DENSE_H

#include <stdint.h>

/* LU with row pivoting in place; 0 where a pivot is zero or no number. */
int lmoc_dense_factor(int64_t n, double *a, int32_t *pivots, double *determinant);

/* B := A^-1 B with these factors; B has `width` columns. */
void lmoc_dense_substitute(int64_t n, const double *a, const int32_t *pivots, int64_t width, double *b);

/* The inverse of a matrix whose condition is below `worst`: 0 where it is not. `a` is overwritten. */
int lmoc_dense_inverse(int64_t n, double *a, int32_t *pivots, double worst, double *inverse);

/* Make a column of a table that of a unit matrix, with 1 in a row. */
void lmoc_dense_eliminate(int64_t rows, int64_t width, double *table, int64_t row, int64_t column);

/* Singular values, and the vectors v where it is not 0; `u`, which is the matrix (m, n) before, gets columns as long as
   these values. */
void lmoc_singular_values(int64_t m, int64_t n, double *u, double *v, double *values);

/* The shortest x that minimizes |A x - b|, from these; values up to `share` of the largest one count as none. */
void lmoc_least_squares(int64_t n, const double *u, const double *v, const double *values, double share,
                        const double *b, double *x);

#endif
