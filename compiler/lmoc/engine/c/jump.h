/* Values that step at an instant while the equations hold derivatives of them, such as a prescribed position, and what
   that does to the states: `numerics/events/impulse.py` says by which equations. */

#ifndef LMOC_JUMP_H
#define LMOC_JUMP_H

#include <math.h>
#include <stdint.h>

/* What a step has come to: no answer of the owner; the motion needs the derivative of an impulse; what follows from the
   step is not proportional to its velocity; its effect does not converge. */
enum { LMOC_JUMPED, LMOC_JUMP_NO_VALUE, LMOC_JUMP_SECOND, LMOC_JUMP_POWER, LMOC_JUMP_ENDLESS, LMOC_JUMP_NO_MEMORY };

/* Tables are positions among what is given: the values that may step, then their derivatives that are not among these. */
typedef struct {
  int64_t states, given, rows, judged;
  const int32_t *lower, *upper, *origin;  /* (rows,) a variable or its derivative, -1 for none; the derivative of that;
                                             the variable */
  const int32_t *second;                  /* (rows,) whether `upper` is a second derivative */
  const int32_t *ledger;                  /* (states,) work and heat, which are no part of the motion */
  void *owner;
  /* The rates of the states, then what is judged, behind the step and with all laws open, `which` (given,) of the values
     having those `given`: 0, or it has no answer. */
  int (*values)(void *owner, const double *x, const int32_t *which, const double *given, double *out);
} lmoc_jump;

/* s, by which what lies just before an instant, and just after it, is away from it. */
static inline double lmoc_beside_step(double time) { return 1e-13 * fmax(1, fabs(time)); }

/* Why a step has come to what it has, in the words of a message. */
const char *lmoc_jump_reason(int status);

/* What values step by, from those just before an instant, before that, just after it, and after that (4, count); whether
   any does. `sides` (2, count): values at the instant, from before and after it. */
int lmoc_steps_between(int64_t count, const double *values, double *sides, double *change);

/* What the states change by with a step of the values that may step: from `old` by `change`, (given,). */
int lmoc_jump_states(const lmoc_jump *j, const double *old, const double *change, const double *x, double *moved);

/* LMOC_JUMP_ENDLESS where the ledger grows with a power of the impulses; else LMOC_JUMPED or no value. */
int lmoc_jump_work(const lmoc_jump *j, const double *old, const double *change, const double *x);

#endif
