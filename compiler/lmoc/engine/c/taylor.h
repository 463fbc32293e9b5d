/* Many steps along Taylor series, for who calls them from C or Python (`taylor.c`). */

#ifndef LMOC_TAYLOR_H
#define LMOC_TAYLOR_H

#include "series.h"

typedef struct {
  lmoc_call *call;
  const lmoc_series *series;
  int64_t order;
} lmoc_taylor;

/* A walk of many steps. `next` is the series that begins at `time`, `q` that of the last step, from `before`. */
typedef struct {
  double time, before, end, longest, length, rtol;
  const double *atol;
  double *q, *next, *x, *between;
  int64_t steps, most, tries;        /* steps in this call, at most in this call; and tried */
  const double *times;               /* output times ahead … */
  double *out;                       /* … and the states at them, as far as there is room */
  int64_t outputs, reached, room;
  const lmoc_step_hook *hook;            /* or 0 */
} lmoc_walk;

/* Coefficients 0 … order of the states at (time, x) into q, (n, LENGTH). Returns 0 where all of them are numbers. */
int lmoc_taylor_series(const lmoc_taylor *y, double time, const double *x, double *q);

/* Steps with their output: as many as allowed, until the end or until there is no room for output within the last one.
   Returns what that has; `x` is the state at `time`. */
int lmoc_taylor_walk(const lmoc_taylor *y, lmoc_walk *s);

#endif
