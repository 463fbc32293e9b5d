/* Many steps along Taylor series, for who calls them from C or Python (`taylor.c`). */

#ifndef LMOC_TAYLOR_H
#define LMOC_TAYLOR_H

#include "series.h"

typedef struct {
  lmoc_call *call;
  const lmoc_series *series;
  int64_t order;
} lmoc_taylor;

/* A walk of many steps; of lanes, each with its own. `next` is the series that begins at `time`, `q` that of the last
   step, from `before`. */
typedef struct {
  double time[LMOC_LANES], before[LMOC_LANES], end, longest, length[LMOC_LANES], rtol[LMOC_LANES];
  const double *atol;                /* (n, lanes) */
  double *q, *next, *x, *between;    /* (n, LENGTH, lanes), (n, lanes) */
  int64_t steps[LMOC_LANES], most[LMOC_LANES], tries[LMOC_LANES]; /* in this call, at most in it; and tried */
  const double *times[LMOC_LANES];   /* output times ahead … */
  double *out[LMOC_LANES];           /* … and the states at them, as far as there is room */
  int64_t outputs[LMOC_LANES], reached[LMOC_LANES], room[LMOC_LANES];
  const lmoc_step_hook *hook;        /* or 0; looks at single runs */
  int64_t found[LMOC_LANES];         /* what there is instead of a further step, or 0 */
  int64_t begins[LMOC_LANES];        /* whether only the state is known, in `next`, and the series is to be found first */
  double ahead[LMOC_LANES];          /* the step that is tried; 0 where it has to be chosen */
  double begun[LMOC_LANES], shortest[LMOC_LANES]; /* since when steps have to be that long in the mean … */
  int64_t made[LMOC_LANES];          /* … and how many there were before this call; looked at by `lanes.c` alone */
} lmoc_walk;

/* Coefficients 0 … order of the states at (time, x) into q, (n, LENGTH, lanes). Returns 0 where all of them are numbers,
   else the bits of the lanes where not. */
int LMOC_NAME(lmoc_taylor_series)(const lmoc_taylor *y, lmoc_times time, const double *x, double *q);

/* The states at distances from where the series of one run begins. */
void lmoc_taylor_values(int64_t n, int64_t order, int64_t count, const double *h, const double *q, double *x);

/* Count from zero what a lane does from here on. */
static inline void lmoc_walk_afresh(lmoc_walk *s, int64_t lane) {
  s->steps[lane] = s->tries[lane] = s->reached[lane] = s->found[lane] = 0;
  s->ahead[lane] = 0;
}

/* Steps with their output: as many as allowed, until the end or until there is no room for output within the last one.
   Ends as soon as one lane has stopped, and returns the bits of those that have; `x` is the state at `time`. */
int64_t LMOC_NAME(lmoc_taylor_go)(const lmoc_taylor *y, lmoc_walk *s);

/* The same for one run, counted from zero; returns what it has found. */
int lmoc_taylor_walk(const lmoc_taylor *y, lmoc_walk *s);

/* Factors of matrices that depend on parameters have to be made anew, and pivots to be chosen anew. */
static inline void lmoc_forget(const lmoc_tape *tape, int64_t blocks) {
  for (int64_t k = 0; k < blocks; k++) {
    tape->blocks[k].ready = 0;
    if (tape->blocks[k].lu) lmoc_lu_forget(tape->blocks[k].lu);
  }
}

#endif
