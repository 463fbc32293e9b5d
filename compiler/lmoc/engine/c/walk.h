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
} lmoc_steps;

/* Steps with their output: as many as allowed, until the end, or until there is no room for output, and the last step
   stays pending. Returns what the last step has; a DOUBTFUL one has been tried and stands there to be judged. */
int lmoc_dop853_walk(lmoc_steps *s);

/* Begin at `x` and `t` with a step of that length, or infinity where it is to be found; 0 where the derivatives are no
   numbers. */
int lmoc_dop853_begin(lmoc_steps *s, double first);

/* Begin anew from where `x` and `t` stand, with a step as long as the next one would have been. */
void lmoc_dop853_restart(lmoc_steps *s);

/* The states at a share of the last step, from 0 to 1, when the first function has made the polynomial of it. Both take
   `x` for where the step has begun. */
void lmoc_dop853_dense(lmoc_steps *s);
void lmoc_dop853_within(const lmoc_steps *s, double theta, double *y);

#endif
