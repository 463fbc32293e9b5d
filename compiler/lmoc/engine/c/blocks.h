/* What Newton's method and linear blocks share. */

#ifndef LMOC_BLOCKS_H
#define LMOC_BLOCKS_H

#include "tape.h"

/* The entries of the matrix of an instance. */
LMOC_INLINE void lmoc_block_fill(const lmoc_block *m, int64_t instance, const double *w, double *a) {
  const int32_t *from = m->fill + instance*m->each;
  for (int64_t k = 0; k < m->each; k++) LMOC_ROW(a, k) = LMOC_ROW(w, from[k]);
}

/* Where the factors of an instance and their pivots are kept. */
LMOC_INLINE double *lmoc_block_factors(const lmoc_block *m, int64_t instance, double *w) {
  return w + LMOC_AT(m->a + instance*m->each);
}
LMOC_INLINE int32_t *lmoc_block_pivots(const lmoc_block *m, int64_t instance) {
  return m->pivots + LMOC_AT(instance*m->size);
}

/* Factorize it; 0 where it is singular or has entries that are no numbers. */
int lmoc_block_factor(lmoc_block *m, double *a, int32_t *pivots, double *determinant);

/* b := A^-1 b. */
void lmoc_block_solve(const lmoc_block *m, const double *a, const int32_t *pivots, double *b);

/* The same with the factors that are kept of an instance; of as many as there are lanes. */
void LMOC_NAME(lmoc_block_substitute)(const lmoc_block *m, int64_t instance, double *w, double *b);

void lmoc_newton_begin(lmoc_block *m, double *w);
int64_t lmoc_newton_step(lmoc_block *m, double *w);
int lmoc_newton_end(lmoc_block *m, double *w, int64_t open);

#endif
