/* The functions whose signs end a segment, along the last step of a method whose values between are a polynomial: what
   `roots.h` asks, with nobody else in between. */

#ifndef LMOC_STEP_FUNCTIONS_H
#define LMOC_STEP_FUNCTIONS_H

#include "engine.h"
#include "instant.h"
#include "law_run.h"

/* Some of them: of laws, or of events, from registers of a program. */
typedef struct {
  lmoc_call *call;
  int64_t chosen;
  const int32_t *registers;
  double *read;               /* (chosen,) room */
  const lmoc_law_run *laws;   /* or 0 */
  lmoc_instant *events;       /* or 0 */
  int64_t count;              /* functions */
} lmoc_watched;

typedef struct {
  int64_t n, parts, count;    /* states; functions in all */
  const lmoc_watched *part;
  double *largest;            /* (n,) magnitudes of the states where the functions have been looked at */
  double *x;                  /* (n,) the place that has been looked at last, and room for what a program is given */
  const double *first, *last; /* (n,) states at the end of the step before, and of this one */
  double begin, end;          /* s: these */
  double before;              /* s, where the polynomial begins */
  int64_t order;
  const double *series;       /* (n, …) its coefficients */
} lmoc_step_functions;

/* As `values` and `quiet` of a finder, whose owner they are. */
int lmoc_step_values(void *owner, int64_t count, const double *times, double *values);
int lmoc_step_quiet(void *owner, double time, const double *heights, uint8_t *out);

/* The states at a time within the step. */
void lmoc_step_states(lmoc_step_functions *s, double time, double *x);

#endif
