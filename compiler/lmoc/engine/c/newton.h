/* When Newton's method has arrived and when it fails: the rules for one instance and for many copies abreast. */

#ifndef LMOC_NEWTON_H
#define LMOC_NEWTON_H

#include <float.h>

#include "tape.h"

#define LMOC_EXACT 1e-13     /* of the size of the unknowns: no correction is smaller in double precision */
#define LMOC_SQUARED 1e-9    /* of their size: a correction whose square is below rounding, where the constant of … */
#define LMOC_CURVED 10       /* … quadratic convergence is no larger, in sizes of the unknowns */
#define LMOC_LOOSE 1e-8      /* good enough where the corrections do not shrink any more */
#define LMOC_ROUNDING 1e-15  /* of the terms of an equation: what their sum may miss zero by */
#define LMOC_WAY 0.25        /* of the size of an unknown: the longest way that is near */

/* How corrections have to shrink, how many there are, and how far off the first one may point. A mechanism has branches
   that must not be left. The equations of springs have one solution, which cubic ones approach by a factor of 2/3 an
   iteration where they relax. */
typedef struct { double rate, near; int64_t most; } lmoc_newton_rule;
extern const lmoc_newton_rule lmoc_newton_rules[2];

/* What is kept of every instance: determinant, length of the last correction (-1: solved), where it began, and where the
   first step led. */
typedef struct { double *det, *before, *start, *target; } lmoc_newton_state;

static inline lmoc_newton_state lmoc_newton_state_of(const lmoc_block *m, double *w) {
  double *work = w + m->work;
  const int64_t n = m->instances;
  return (lmoc_newton_state){work, work + n, work + 2*n, work + 2*n + n*m->size};
}

/* Whether what is left behind a correction is below rounding: corrections shrink as the square of the one before, times
   a constant that these two tell (Deuflhard, section 2.1). Near a singular place, where it is large, none is left out. */
#define LMOC_NEWTON_ARRIVED(length, before, size) \
  (((length) <= LMOC_EXACT * (size)) | (((before) <= DBL_MAX) & ((length) <= LMOC_SQUARED * (size)) & \
                                        ((length) * (size) <= LMOC_CURVED * (before) * (before))))

#endif
