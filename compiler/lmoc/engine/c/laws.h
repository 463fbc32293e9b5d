/* The laws of a scene at an instant, and which of them hold from there on. */

#ifndef LMOC_LAWS_H
#define LMOC_LAWS_H

#include "complementarity.h"

enum { LMOC_POSITION = 2 };   /* relative degree of a gap between inertias */

/* What never changes, an entry for each law. */
typedef struct {
  int64_t count;
  const int64_t *degree, *normal;      /* which law's force is the normal force of contact friction */
  const lmoc_flag *complementary, *dry, *contact;
} lmoc_laws;

/* Values with all laws open and their forces zero: levels y, and how they depend on forces; limits of friction, not
   negative. Those of contact friction are shares of the normal force. */
typedef struct {
  const double *bias, *delassus, *slip, *stick;
} lmoc_levels;

/* A mode with its forces, and the levels that they lead to (`numerics/problem/mode.py`). `laws`: where there is none,
   those that contradict each other. */
typedef struct {
  lmoc_flag *closed, *implied, *unique, *laws;
  int64_t *direction;
  double *push, *force, *level;
} lmoc_settled;

/* What stands in the registers of the switched form in a mode: of (3, laws), closed, push, direction. */
double lmoc_mode_input(const lmoc_settled *mode, int64_t laws, int64_t which);

/* The mode that holds from an instant on: SOLVED, NO_SOLUTION where no forces satisfy the laws, such as of a body that
   is pressed between two stops, or Painleve's paradox.

   `closed` before; where both sides of a law would do, it stays where it was. `candidate`: laws that could be closed
   from here on; `sliding`: direction of friction that is none; `at_limit`: direction in which stuck friction begins to
   slide that has just reached its limit, else 0; `opening`: laws that could be closed but open here. */
int lmoc_settle(const lmoc_laws *laws, const lmoc_levels *now, const lmoc_flag *closed, const lmoc_flag *candidate,
                const int64_t *sliding, const int64_t *at_limit, const lmoc_flag *opening, lmoc_settled *found);

#endif
