/* Many steps of DOP853, for who calls them from C or Python (`walk.c`). */

#ifndef LMOC_WALK_H
#define LMOC_WALK_H

#include "engine.h"

typedef struct {
  double safety, shrink, grow, retry;                 /* factors on the length of a step */
  double rough_from, rough, careful, careful_steps;   /* where dense output is less accurate than the step */
  double stiff_limit, stiff_steps, calm_steps;
  double cuts, pace;                                  /* where values are not finite */
  double least;                                       /* s */
} lmoc_rules;

/* The state of the method. `k` are the stages of the last step, from `x` to `x_new`; while it is pending, they stand for
   output, and `t` is already its end. Whoever judges it has moved its end to `landed` where there is one who lands. */
typedef struct {
  lmoc_call *call;
  const lmoc_rules *rules;
  const double *weights, *nodes, *dense, *omitted, *atol;
  double *x, *f, *x_new, *k, *last, *terms, *landed;
  double t, before, step_size, length, error, stiffness, grow, stiff_count, calm_count, careful;
  double cuts, cuts_since;
  int64_t pending, staged, lost;
  double rtol, end, max_step, patience;
  int64_t steps, rejected, evaluations, most;         /* in this call; steps and rejected ones at most */
  const double *times;                                /* output times ahead … */
  double *out;                                        /* … and the states at them, as far as there is room */
  int64_t outputs, reached, room;
  const lmoc_step_hook *hook;                         /* or 0 */
  double trial, goal;                                 /* the step that is tried, and where it ends */
} lmoc_steps;

/* Steps with their output: as many as allowed, until the end, or until there is no room for output, and the last step
   stays pending. Returns what the last step has; a DOUBTFUL one has been tried and stands there to be judged. */
int lmoc_dop853_walk(lmoc_steps *s);

/* Begin at `x` and `t` with a step of that length, or infinity where it is to be found; 0 where the derivatives are no
   numbers. */
int lmoc_dop853_begin(lmoc_steps *s, double first);

/* A first step is to be no shorter. */
static inline double lmoc_dop853_least(const lmoc_steps *s) { return fmax(s->rules->least, 2*8e-16*fabs(s->t)); }

/* What a walk consists of, for who evaluates f in between: at stages 1 to 12 of a step that is proposed, at 13 to 15 of one
   that is to be judged within or has been accepted and shows. */
enum { LMOC_GOOD, LMOC_AGAIN, LMOC_ROUGH };
void lmoc_dop853_afresh(lmoc_steps *s);
int lmoc_dop853_choose(lmoc_steps *s);  /* a step of the length that was chosen; 0, or LOST */
int lmoc_dop853_propose(lmoc_steps *s); /* the step that is tried; 0, or what there is instead */
/* Whether the step just tried is GOOD, to be tried AGAIN with another length, or perhaps ROUGH within; `result` is what
   `lmoc_dop853_errors` has found. */
int lmoc_dop853_judge(lmoc_steps *s, const double *result);
int lmoc_dop853_judge_within(lmoc_steps *s);
/* Accept the step just tried, and choose the length of the next. Returns 0, or STIFF where too many of them would lie
   ahead and the last ones were limited by stability. */
int lmoc_dop853_accept(lmoc_steps *s);
/* Whether the last step has reached an output time that has not been seen to. */
int lmoc_dop853_shows(const lmoc_steps *s);
/* Output within the last step, if it is pending, and stand at its end. Returns whether there is to be no further one. */
int lmoc_dop853_arrive(lmoc_steps *s);

/* Begin anew from where `x` and `t` stand, with a step as long as the next one would have been. */
void lmoc_dop853_restart(lmoc_steps *s);

/* The states at a share of the last step, from 0 to 1, when the first function has made the polynomial of it. Both take
   `x` for where the step has begun. */
void lmoc_dop853_dense(lmoc_steps *s);
void lmoc_dop853_within(const lmoc_steps *s, double theta, double *y);

#endif
