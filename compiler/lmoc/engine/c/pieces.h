/* From one kink of the right-hand side to the next, without Python in between (`pieces.c`). */

#ifndef LMOC_PIECES_H
#define LMOC_PIECES_H

#include "taylor.h"
#include "walk.h"

/* A run over pieces between kinks, and what has become of it. A piece begins and ends so near to its kinks that no stage
   of a step sees the other side. */
typedef struct {
  int64_t count;                         /* pieces ahead */
  const double *begin, *end, *longest;   /* (count,) s; the last of the steps */
  int64_t most, overrun, all;            /* steps and rejected ones: in a piece, more of them where they are expected to
                                            reach its end, and after which none is begun */
  const double *times;                   /* output times ahead, each within its piece … */
  double *out;                           /* … and the states at them, as far as there is room */
  int64_t outputs, room;
  double *kept;                          /* n, and 3 (remembered + given): where a piece has begun */
  int64_t passed, steps, rejected, evaluations, reached;
  double before, time;                   /* s, where the last step has begun, and where the run stands */
  int64_t stuck;                         /* whether the next piece takes more steps, or another method */
} lmoc_pieces;

/* Go on from the end of a piece, as far as it takes few steps from one kink to the next. Where it takes more, the run stands
   at the end of the piece before. */
void lmoc_dop853_pass(lmoc_steps *s, lmoc_pieces *p);
void lmoc_taylor_pass(const lmoc_taylor *y, lmoc_walk *s, lmoc_pieces *p);

#endif
