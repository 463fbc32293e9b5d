/* The events of a run on its way: its start, what follows where a segment has ended, and where laws have changed something. */

#ifndef LMOC_HAPPEN_H
#define LMOC_HAPPEN_H

#include "hops.h"

/* Behind what hops come to: conditions switch too often within a moment; and there is nothing left to happen. */
enum { LMOC_TOO_OFTEN = 17, LMOC_OVER = -2 };
enum { LMOC_WHEN, LMOC_TIME, LMOC_TERMINAL, LMOC_START };  /* what an event is called */

/* What it stands at, and who is asked: functions return 0, or what the instant comes to. */
typedef struct lmoc_events {
  lmoc_instant *e;
  lmoc_hops *h;
  int64_t initial, terminal;        /* places of initial() and terminal(), -1 where there is none */
  double *next, *turned;            /* s, of the next time event; of the latest that has changed the motion */
  const double *errors;             /* (states,) what the integrator has allowed itself in a step; 0: nothing is known */
  double *defect;                   /* (states,) by which rates differ from slopes of its way in that step, at most … */
  double *begun, *held;             /* (states,), (discrete,) before the latest event */
  double *which, *turn, *at;        /* (zeros,) that cross zero, 2: upwards; that turn back; what they are before that */
  double *folds;                    /* (zeros,) that cross it again where they have just done so; or 0, as `fold` */
  int64_t kind, jumped, culprit;    /* of that event; whether it has moved the states; which function is to blame */
  void *owner;
  int (*happened)(struct lmoc_events *v, double time, double *x);  /* book and tell; where x moves on, `jumped` is to say so */
  int (*states)(struct lmoc_events *v, double *x);    /* those that discrete values lead to at the start; 0: as they are */
  int (*equations)(struct lmoc_events *v, int first); /* values of discrete variables with an equation at the start */
  int (*fold)(struct lmoc_events *v, double time, double *x); /* values for those that cross again, LMOC_UNSETTLED: as others; or 0 */
  void (*defects)(struct lmoc_events *v);             /* … which this fills; or 0 */
} lmoc_events;

/* States and discrete values that agree, and what happens at the start. `tried`: nothing happens, they only agree. */
int lmoc_events_start(lmoc_events *v, double time, double *x, int tried);

/* What happens where a segment has ended: because functions have crossed zero, `which`, or else at its time. */
int lmoc_events_after(lmoc_events *v, double time, double *x, int crossed);

/* What follows from a change of the continuous equations. */
int lmoc_events_settle(lmoc_events *v, double time, double *x);

/* Leave those of the functions that seem to cross zero, `which`, that a step leaves open; whether there are others
   (`stiff_states.c`). */
int lmoc_without_noise(lmoc_events *v, double time, const double *x, int *some);

#endif
