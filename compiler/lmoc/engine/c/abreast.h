/* Runs of one scene that go on side by side (`abreast.c`). */

#ifndef LMOC_ABREAST_H
#define LMOC_ABREAST_H

#include "walk.h"

/* Forget what blocks have factorized and their order of pivots: registers that they read hold other values now. */
void lmoc_forget(const lmoc_tape *t, int64_t blocks);

/* Runs of one scene that go on side by side, each from where it stands and to its own time, with values of its own in
   some registers. */
typedef struct {
  int64_t runs, blocks, given, most;     /* blocks of the tape; registers that are given values; steps at most */
  lmoc_steps *const *each;
  const int64_t *registers;
  const double *values, *ends;           /* (runs, given); s */
  double *x;                             /* (runs, n) where they have come to */
  int64_t *found, evaluations;           /* what the last step of each has had, as for a walk */
} lmoc_abreast;

/* Returns how many have not come to their ends. */
int64_t lmoc_dop853_abreast(lmoc_abreast *a);

#endif
