/* Onto what closed laws keep at zero, and what these hold. */

#ifndef LMOC_MANIFOLD_H
#define LMOC_MANIFOLD_H

#include "complementarity.h"

/* dx (columns,) with A dx = b and as few entries as A has independent rows. */
int lmoc_correction(int64_t rows, int64_t columns, const double *a, const double *b, double *dx);

/* Which velocities vanish wherever linear forms in them do, as those of a body that sticks on a slope: their derivatives
   are zero then, not rounding of the forces. Rows of the eliminated forms with a single entry tell; forms with entries that are no numbers do not take part. */
int lmoc_held_velocities(int64_t forms, int64_t columns, const double *coefficients, lmoc_flag *held);

#endif
