/* A scene with all laws open: the quantities of its laws, and their dependence on forces and states, by its programs. */

#ifndef LMOC_FREE_DYNAMICS_H
#define LMOC_FREE_DYNAMICS_H

#include "kinematics.h"
#include "tape.h"

/* Derivatives by the forces stand in (n + states, n), the levels before the rates of the states; those of gaps and rates
   by the states in (2 n, states). */
enum { LMOC_BY_FORCE, LMOC_BY_STATE };

typedef struct {
  int64_t laws, states, stored;  /* register of the stored energy; -1 for none */
  int64_t count[2];              /* of derivatives that are not zero: where they stand on each tape, and in its matrix */
  const int32_t *place[2], *entry[2];
  double *w[2];
  const lmoc_tape *tape[2];
  const int32_t *state;          /* (states,) registers, of both */
  const int32_t *quantity;       /* (6, n) registers of gap, rate, level, limits while slipping and sticking, force … */
  const double *known;           /* … -1 where they are parameters, or no number where there are none */
  const int32_t *inputs;         /* (3, n) registers of a mode, as of `lmoc_mode_input`; -1: none */
  int64_t lost;                  /* whether a nonlinear block has had no solution near the values it begins with */
} lmoc_free_dynamics;

/* As `lmoc_kinematics` asks it. */
int lmoc_free_at(void *own, double time, const double *x, const lmoc_settled *mode, double *values);

#endif
