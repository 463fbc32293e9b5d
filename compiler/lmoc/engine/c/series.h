/* Taylor coefficients of everything that a program computes: those of order k from those of lower orders. */

#ifndef LMOC_SERIES_H
#define LMOC_SERIES_H

#include "engine.h"

#define LMOC_LENGTH 32 /* coefficients that a series has room for */

/* Instructions in the order of `lower/series.py`; operands are series, or places of numbers (n). */
#define LMOC_RECURRENCES(X) \
  X(end) X(copy) X(neg) X(add) X(sub) X(scale) X(ratio) X(convolve) X(square) X(quotient) X(power) X(chain) \
  X(chain_more) X(scale_more) X(total) X(open) X(solve)

typedef struct {
  double *w;                /* registers, in which a program has been run, and scratch */
  const lmoc_tape *start;   /* fills the coefficients of order zero that are no registers, and factorizes blocks */
  const int32_t *code;
  const int32_t *source;    /* (count,) the place of the coefficient of order zero */
  int64_t count, clock;     /* series; that of time, or -1 */
  const int32_t *states, *derivatives; /* (n,) series */
  const int32_t *of_register; /* series of unknowns and residuals of blocks, by their registers */
  double *s;                /* (count, LENGTH) */
} lmoc_series;

/* Coefficients of order zero. Returns 0 where a block can be solved. */
int lmoc_series_begin(const lmoc_series *y, double time);

/* Coefficients of order k > 0. */
void lmoc_series_order(const lmoc_series *y, int64_t k);

#endif
