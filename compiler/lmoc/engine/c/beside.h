/* What the iteration of events finds by looking beside a place, where nobody tells it. */

#ifndef LMOC_BESIDE_H
#define LMOC_BESIDE_H

#include "instant.h"

/* Margins of functions that are zero but for rounding, as `widen` of an instant sets them: how much rounding there is in
   them is seen where the states change by it. What is exactly zero and stays that does not pass through zero, and has no
   margin. `work`: states + 3 zeros. */
int lmoc_widen_beside(lmoc_instant *e, double time, const double *x, double *work);

/* The one state that a variable of a `reinit` follows from, changed so that it has a value, as `move` of an instant does;
   `seen` tells the variable for some states, NaN where it has no value. `work`: 2 states. */
enum { LMOC_MOVED, LMOC_NOT_ONE, LMOC_NOWHERE };
int lmoc_move_one(lmoc_instant *e, double (*seen)(lmoc_instant *e, const double *x, int64_t reinit), const double *from,
                  int64_t reinit, double wanted, double *moved, double *work);

#endif
