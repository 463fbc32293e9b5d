/* The laws of a scene at an instant: gaps, rates, the effect of their forces; and the way from one instant to another. */

#ifndef LMOC_KINEMATICS_H
#define LMOC_KINEMATICS_H

#include "laws.h"

enum { LMOC_JENKINS = -1 };  /* relative degree of friction between springs: its force is a state */
/* Why there is no way: what an owner has halted; or laws that contradict each other, since no states, impulses or forces
   satisfy them. */
enum { LMOC_HELD_UP = 2, LMOC_NO_STATES = 3, LMOC_NO_IMPULSES = 4, LMOC_NO_FORCES = LMOC_NO_SOLUTION };

/* Values at a time and states, with all laws open and their forces zero, by rows: one piece of memory. */
typedef struct {
  double time;
  double *x;                             /* (states,) */
  double *gap, *rate;                    /* (n,) no number where a law has none */
  double *gap_scale, *rate_scale;        /* (n,) sizes of the terms whose sums they are */
  double *bias, *slip, *stick;           /* (n,) levels; limits of friction, no number for others */
  double *force;                         /* (n,) those of Jenkins friction, which are states; no number for others */
  double *delassus, *response, *slope;   /* (n, n) levels by forces; (states, n) rates of states; (2, n, states) gaps and
                                            rates by the states */
  double *stored;                        /* J, no number without a ledger */
} lmoc_contact;

/* The scene, and who is asked. */
typedef struct {
  lmoc_laws laws;
  int64_t states;
  const lmoc_flag *unilateral, *ledger;  /* (n,), (states,) which states only keep accounts */
  const double *restitution;             /* (n,) */
  const double *errors, *unresolved;     /* (states,) what the integrator allows itself in a step; what it tells apart by no
                                            more … */
  int64_t guessed;                       /* … for all that is known: hops are over that the integrator shows not to resolve */
  void *owner;                           /* 0 where an answer is good */
  int (*at)(void *owner, double time, const double *x, const lmoc_settled *mode, double *values); /* (`lmoc_contact_size`,)
                                            behind the states; levels in a mode, or 0 where all laws are open */
  int (*exact)(void *owner, double time, const double *x, const lmoc_flag *which, double *bias); /* levels of these laws
                                            that are rounding alone become zero; or 0 */
  int64_t ties;                                    /* equations between states that hold whatever the laws do, such as the
                                                      closures of loops whose coordinates are all states, and … */
  int (*tie)(void *owner, double time, const double *x, double *value, double *slope);  /* … (ties,) what is left of each,
                                                      (ties, states); or 0 */
} lmoc_kinematics;

/* Doubles of an instant, and their places. */
int64_t lmoc_contact_size(int64_t laws, int64_t states);
void lmoc_contact_place(int64_t laws, int64_t states, double *memory, lmoc_contact *to);

void lmoc_contact_copy(int64_t laws, int64_t states, const lmoc_contact *from, lmoc_contact *to);

int lmoc_contact_at(const lmoc_kinematics *k, double time, const double *x, lmoc_contact *to);

/* Move states to where some gaps and rates are zero, nearby: by Newton's method. `spare` is another place for an instant;
   `laws` (n,) are those that have no such states. */
int lmoc_project(const lmoc_kinematics *k, const lmoc_flag *gaps, const lmoc_flag *rates, lmoc_contact *now,
                 lmoc_contact *spare, lmoc_flag *laws);

/* By what gaps, or rates, may have drifted that have such derivatives by the states, (count, states), with such `errors`
   in a step. */
void lmoc_drift(int64_t count, int64_t states, const double *slope, const double *errors, double *out);

#endif
