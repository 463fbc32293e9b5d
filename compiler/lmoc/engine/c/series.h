/* Taylor coefficients of everything that a program computes: those of order k from those of lower orders. */

#ifndef LMOC_SERIES_H
#define LMOC_SERIES_H

#include "engine.h"

/* Coefficients that a series has room for. Those of lanes are no power of two apart, so that they do not all meet in one
   set of the cache. */
#if LMOC_LANES > 1
#define LMOC_LENGTH 27
#else
#define LMOC_LENGTH 32
#endif

/* Instructions in the order of `lower/series_code.py`; operands are series, or places of numbers (n). */
#define LMOC_RECURRENCES(X) \
  X(end) X(copy) X(neg) X(add) X(sub) X(scale) X(ratio) X(convolve) X(square) X(quotient) X(power) X(chain) \
  X(chain_more) X(scale_more) X(total) X(open) X(solve) X(late) X(of_time)

typedef struct lmoc_series {
  void (*order)(const struct lmoc_series *y, int64_t k); /* coefficients of order k > 0; compiled or not */
  void (*open)(const struct lmoc_series *y, int64_t block, int64_t k);  /* a block with its unknowns as if … */
  void (*solve)(const struct lmoc_series *y, int64_t block, int64_t k); /* … they were zero, and as they are */
  double *w;                /* registers, in which a program has been run, and scratch */
  const lmoc_tape *start;   /* fills the coefficients of order zero that are no registers, and factorizes blocks */
  const int32_t *code;
  const int32_t *source;    /* (count,) the place of the coefficient of order zero */
  int64_t count, clock;     /* series; that of time, or -1 */
  const int32_t *states, *derivatives; /* (n,) series */
  const int32_t *of_register; /* series of unknowns and residuals of blocks, by their registers */
  double *s;                /* (count, LENGTH, lanes) */
} lmoc_series;

/* Coefficients of order zero. Returns 0 where a block can be solved, else the bits of the lanes where none can. */
int LMOC_NAME(lmoc_series_begin)(const lmoc_series *y, lmoc_times time);

/* What stands in a series that is not compiled. */
void LMOC_NAME(lmoc_series_order)(const lmoc_series *y, int64_t k);
void LMOC_NAME(lmoc_series_open)(const lmoc_series *y, int64_t block, int64_t k);
void LMOC_NAME(lmoc_series_solve)(const lmoc_series *y, int64_t block, int64_t k);

#endif
