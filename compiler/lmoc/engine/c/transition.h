/* What happens to the laws of a scene at an instant, at the start or where a law reaches its end.

   In this order: the states are moved onto the constraints of what is closed or closing; where something closes with a
   velocity, impulses change the velocities; then the forces decide which laws hold from here on (`mode.c`, and the owner
   where the law acts between springs). */

#ifndef LMOC_TRANSITION_H
#define LMOC_TRANSITION_H

#include "kinematics.h"

/* The reason for the end of a segment, an entry for each law. */
typedef struct {
  const lmoc_flag *closing;    /* open laws whose gap or sliding velocity has come to zero */
  const lmoc_flag *opening;    /* laws whose force has come to its end here; those that have opened at the same time before
                                  among them */
  const int64_t *direction;    /* in which friction among them begins to slide */
  int64_t jumped;              /* the states have been changed from outside: what is closed may move */
  const double *left;          /* rates with which laws have left at their last impacts; 0: they have not */
  const double *idle;          /* roots in sequence at which nothing has happened */
} lmoc_trigger;

/* The consequences. */
typedef struct {
  lmoc_settled settled;        /* the new mode with its forces; `laws`: those that contradict each other */
  lmoc_contact *now;           /* behind the impulses, on what is closed, with levels without rounding */
  double stored;               /* J, before the impulses */
  double *impulse, *lost;      /* (n,) along the laws, and the energy that each takes out */
  lmoc_flag *touched;          /* (n,) whose motion, the gap or the velocity that closes it, is zero */
  lmoc_flag *accumulated;      /* (n,) whose bounces are over */
  lmoc_flag *undecided;        /* (n,) that would be left with other rates if they were hit one after the other */
  double until;                /* s, when those bounces would have ended */
  int64_t law;                 /* LMOC_NEWTON, LMOC_POISSON; -1: no impact */
} lmoc_changed;

/* LMOC_SOLVED, or why there is no way (`kinematics.h`). `closed` (n,) before. */
int lmoc_transition(const lmoc_kinematics *k, double time, const double *x, const lmoc_flag *closed,
                    const lmoc_trigger *trigger, lmoc_changed *found);

#endif
