/* Impacts: the impulses with which closed and closing laws stop each other, all at the same instant. */

#ifndef LMOC_IMPACT_H
#define LMOC_IMPACT_H

#include "complementarity.h"

enum { LMOC_NEWTON, LMOC_POISSON };

/* The impulses (n,) of laws that touch, the rates behind them, and the energy that each takes out; `side` is a guess
   where the impulses are between their bounds, or 0. `law` tells which one has decided. Without a solution `impulse` is
   the last iterate. */
int lmoc_collide(int64_t n, const double *delassus, const double *rate, const double *restitution,
                 const lmoc_friction *friction, const int64_t *side, double *impulse, double *after, double *lost,
                 lmoc_flag *unique, int *law);

/* Whether some laws without friction would be left with other rates than `after` if they were hit one after the
   other. */
int lmoc_depends_on_order(int64_t n, const double *delassus, const double *rate, const double *restitution,
                          const double *after);

#endif
