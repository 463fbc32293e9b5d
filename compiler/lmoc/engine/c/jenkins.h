/* Friction between springs, without a mass or a damper that would make its velocity a state (Jenkins' element). */

#ifndef LMOC_JENKINS_H
#define LMOC_JENKINS_H

#include "strike.h"

enum { LMOC_AT_LOWER = 1, LMOC_AT_UPPER = 2 };  /* bits of the limits at which a force is */

/* Bring its forces within their limits: the springs move, and `now` with them; `limits` (n,) are where they are then.
   `closed` before; `opening` begin to slide here in `direction`. `lost` (n,) gets what it costs; `room` is memory. */
int lmoc_jenkins_relax(const lmoc_kinematics *k, const lmoc_flag *closed, const lmoc_flag *opening, const int64_t *direction,
                       lmoc_contact *now, lmoc_contact *spare, lmoc_impact *room, lmoc_flag *limits, double *lost,
                       lmoc_flag *laws);

/* What it does in the mode that has been found for the others: stick, or slide in which direction. */
int lmoc_jenkins_decide(const lmoc_kinematics *k, lmoc_contact *now, lmoc_contact *spare, lmoc_impact *room,
                        const lmoc_flag *limits, lmoc_settled *found);

#endif
