/* What Newton's method and linear blocks share. */

#ifndef LMOC_BLOCKS_H
#define LMOC_BLOCKS_H

#include "tape.h"

/* The entries of the matrix of an instance. */
void lmoc_block_fill(const lmoc_block *m, int64_t instance, const double *w, double *a);

/* Factorize it; 0 where it is singular or has entries that are no numbers. */
int lmoc_block_factor(lmoc_block *m, double *a, int32_t *pivots, double *determinant);

/* b := A^-1 b. */
void lmoc_block_solve(const lmoc_block *m, const double *a, const int32_t *pivots, double *b);

void lmoc_newton_begin(lmoc_block *m, double *w);
int64_t lmoc_newton_step(lmoc_block *m, double *w);
int lmoc_newton_end(lmoc_block *m, double *w, int64_t open);

#endif
