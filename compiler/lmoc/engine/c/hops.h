/* Zero functions that a jump of states sends back to the side that they came from, and conditions that switch again and
   again without the run getting on: nothing behind that instant is known. A ball whose hop is too low to be told from
   none goes on through its floor. */

#ifndef LMOC_HOPS_H
#define LMOC_HOPS_H

#include "instant.h"

enum { LMOC_CHATTER = 12, LMOC_TOO_LOW = 16 };  /* behind what an instant comes to */

typedef struct {
  double *times;           /* (zeros, LMOC_CHATTER) s, when each has crossed zero; -infinity before */
  double *home;            /* (zeros,) s, before which one that has left zero is not back */
  double *work;            /* 4 states + 9 zeros */
  double begin, span;      /* s, of the run */
  double step;             /* s, over which the motion is smooth: the last one of the method */
  double soon;             /* s, after which the first one that has just left zero is back; infinity: none has */
  int (*motion)(lmoc_instant *e, double time, const double *x, double *rates, double *zeros); /* or what it came to */
} lmoc_hops;

/* Take note of what crosses zero; a function that does so too often within a moment, else -1. */
int64_t lmoc_cross(const lmoc_instant *e, lmoc_hops *h, double time, const double *which);

/* Which of those that have just crossed zero leave it at once behind a jump, to the side they came from: `turn` (zeros,).
   LMOC_TOO_LOW: these have hops too low to be told from none. `before`, `x`: states on both sides of the jump; `at`
   (zeros,): the functions before it. */
int lmoc_turned_back(lmoc_instant *e, lmoc_hops *h, double time, const double *before, const double *x,
                     const double *which, const double *at, double *turn);

/* LMOC_TOO_LOW where functions that have just left zero seem to be back, and move away from it: `wrong` (zeros,). */
int lmoc_wrong_way(lmoc_instant *e, lmoc_hops *h, double time, const double *x, const double *which, double *wrong);

#endif
