/* What ends a mode of the laws of a scene. */

#ifndef LMOC_SWITCHING_H
#define LMOC_SWITCHING_H

#include "kinematics.h"

/* The laws of a run between two events, an entry for each. */
typedef struct {
  lmoc_laws laws;
  int64_t states;
  const lmoc_flag *unilateral;
  const lmoc_flag *curved;     /* whose gaps integrators keep within their errors alone */
  const double *limits;        /* sticking limits that are parameters; no number for others */
  const double *noise;         /* what levels are by rounding alone */
  const lmoc_flag *closed, *implied;
  const int64_t *direction;    /* of friction that slides */
  const lmoc_flag *touched;    /* whose motion was zero where the segment has begun */
  const double *idle;          /* roots in sequence at which nothing has happened */
} lmoc_switching;

/* The functions that are positive as long as the mode holds: one a law, and behind them one more for each that sticks.
   `read` (count, 4 n): motions, rates, forces and sticking limits at some places; the motion is the gap of laws that have
   one, else the rate. `apart`: what is added, or 0. */
int64_t lmoc_law_roots(const lmoc_switching *s, int64_t count, const double *read, const double *apart, double *out);

/* What keeps functions, with values where a segment begins, from being noticed at once that begin at zero up to rounding.
   `errors` (states,): what the integrator allows itself in a step. */
void lmoc_law_apart(const lmoc_switching *s, const lmoc_contact *now, const double *errors, const double *values,
                    double *apart);

#endif
