/* The right-hand side of a system and what makes steps with it. */

#ifndef LMOC_ENGINE_H
#define LMOC_ENGINE_H

#include "tables.h"
#include "tape.h"

typedef struct lmoc_call {
  double *w;
  const lmoc_tape *tape;
  int64_t n, given, first_state; /* states; with the inputs that Python gives behind them */
  const int32_t *states, *derivatives;
  double *(*data)(void *);
  int64_t remembered, solved;   /* unknowns of nonlinear blocks; whether they have been solved before … */
  const int32_t *unknowns;
  double *solution, *x, time;   /* … and how, with which states, and when */
  int (*rescue)(double time);
  double marked_time;
  int64_t marked;               /* whether a solution has been marked; it stands behind the others */
  const struct lmoc_call **last;  /* whose last solution stands in the registers, which several may share; or 0 */
  const double *samples;        /* values of those inputs at the stages of a step */
  const lmoc_tables *tables;    /* tables that inputs follow; or 0 */
} lmoc_call;

/* Run the program for some states. Nonlinear blocks start from their last solution and stay near it; where that is
   impossible, they have none, and keep the last one for the next time. */
int lmoc_evaluate(lmoc_call *c, double time, const double *x);

/* The same on the branch of the solutions that stand in the registers, whatever the last ones were. Pivots are to be those of
   this place: near a singular one, those of another lose digits with each loop in a row. */
int lmoc_evaluate_near(lmoc_call *c, double time, const double *x);

/* Mark the last solution as one to go back to: that of an accepted step. */
void lmoc_mark(lmoc_call *c);
void lmoc_go_back(lmoc_call *c);

/* For many times: states (count, n) and guesses of the unknowns (count, remembered) in, some registers (count, chosen) out;
   whether all of them are solved. */
void lmoc_evaluate_many(lmoc_call *c, int64_t count, const double *times, const double *x, const double *guesses,
               int64_t chosen, const int32_t *registers, double *out, uint8_t *good);

/* f at a place; no numbers where there is none. */
void lmoc_derivatives(lmoc_call *c, double time, const double *x, double *f);

/* What looks at steps that are made without Python in between: the closures of loops (`formulations/landing.py`), or the
   choice of coordinates (`coordinates/condition_bounds.py`). */
typedef struct {
  void *own;
  int (*look)(void *own, double time, const double *x, int first); /* 0 where the way to a place is certainly good: from
                                       the one kept where `first`, else from the last look */
  int (*land)(void *own, double time, double *x);  /* move a state onto the closures: 0 where that is a short way; or 0 */
  void (*keep)(void *own);             /* take the last look for the end of a step */
  int64_t pieces;                      /* into which a way may be divided to look at it more closely */
} lmoc_step_hook;

/* What there is instead of a step: none is short enough; there is no value beyond; it is to be judged in Python. Or it
   is the last one, since the problem is stiff. */
enum { LMOC_SHORT = 1, LMOC_LOST = 2, LMOC_DOUBTFUL = 3, LMOC_STIFF = 4 };

/* One step of DOP853 from (time, x) with k[0] = f: the new state, the error, |h*lambda|.
   Rows of `a`: the 16 stages, then B, E5, E3. */
void lmoc_dop853_attempt(lmoc_call *c, double time, double h, double rtol, const double *a, const double *times,
                         const double *x, const double *atol, double *k, double *x_new, double *last, double *result);

/* Its parts: where a stage is, from those before; and what it has found, from all of them. */
void lmoc_dop853_stage(int64_t n, int stages, const double *a, double h, const double *x, const double *k, double *out);
void lmoc_dop853_errors(int64_t n, double h, double rtol, const double *a, const double *x, const double *atol,
                        const double *k, const double *x_new, const double *last, double *result);

/* The three further stages that dense output needs. Nonlinear blocks go on from where they have been marked, so that
   steps do not depend on which output times there are. */
void lmoc_dop853_more(lmoc_call *c, double time, double h, const double *a, const double *times, const double *x,
                      double *k, double *work);

/* A first step size (Hairer, Nørsett, Wanner I, II.4), before f has been evaluated at its end, and behind that. */
double lmoc_first_trial(int64_t n, double span, double longest, double least, double rtol, const double *atol,
                        const double *x, const double *f);
double lmoc_first_step(int64_t n, double h, double span, double rtol, const double *atol, const double *x,
                       const double *f, const double *trial);

#endif
