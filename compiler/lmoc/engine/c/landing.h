/* The closures of loops whose coordinates are all states: the way back onto them, and their rank (`landing.c`). */

#ifndef LMOC_LANDING_H
#define LMOC_LANDING_H

#include "engine.h"

/* Loops of equal shape: matrices (loops, m, n), their columns in the sizes of the coordinates. */
typedef struct {
  int64_t loops, m, n, entries;
  const int32_t *rows, *columns;   /* residuals (loops, m) and states (loops, n) */
  const int32_t *source, *place;   /* entries of the stage's Jacobian, and where they stand in the matrices */
  double *sizes;                   /* (loops, m) the lengths that the rows have had */
  double *kept, *last, *now;       /* the matrices where the last step has ended, at the last look, and here */
  double *margins;                 /* (3, loops) bounds of their smallest singular values */
  double *work;                    /* m (m + 2) */
} lmoc_loops;

typedef struct {
  int64_t residuals, entries, groups;
  lmoc_loops *group;
  double *out;                     /* entries, then residuals … */
  double *w;                       /* … from the registers, */
  const lmoc_tape *tape;
  const int32_t *results;          /* where they stand afterwards */
} lmoc_closure_stage;

typedef struct {
  int64_t n, stages;
  const int32_t *states;
  const double *scale;             /* (n,) sizes of the states; 0 of one that is held where others are moved */
  lmoc_closure_stage *stage;       /* positions, then velocities; or velocities alone */
  double firm;                     /* smallest singular value from which closures are far from depending on each other */
  double found[2], largest[2];     /* largest residuals of the stages: at the last landing, and at all steps */
} lmoc_closures;

/* Follow the matrices of the first stage to another place: from the one kept where `first` is 1, from the last look
   where it is 0, from nowhere where it is -1. Returns 0 where they keep their rank on the way. */
int lmoc_look(void *own, double time, const double *x, int first);

/* What is left of each closure, of all stages, and its derivatives by the states of its stage, rows of all states. Returns 0
   where they are numbers. */
int64_t lmoc_closure_count(const lmoc_closures *c);
int lmoc_closure_rows(const lmoc_closures *c, double time, const double *x, double *value, double *slope);

/* Take the last look for the end of a step. */
void lmoc_keep(void *own);

/* Move a state onto the closures, positions before velocities. Returns 0 where that is a short way. */
int lmoc_land(void *own, double time, double *x);
int lmoc_land_rates(lmoc_closures *c, double time, double *x);  /* velocities alone */
int lmoc_land_many(void *own, int64_t count, const double *times, double *x);

#endif
