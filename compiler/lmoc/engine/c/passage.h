/* A step over a place where the constraints of a mechanism depend on each other (`passage.c`). */

#ifndef LMOC_PASSAGE_H
#define LMOC_PASSAGE_H

#include <stdint.h>

enum { LMOC_PASSAGE_PLACES = 10, LMOC_BESIDE = 4 };

/* What passes, and the places of the step that has been found: its beginning, the stages, its end. */
typedef struct {
  int64_t n, m;                  /* states, unknowns of nonlinear blocks */
  void *owner;
  int (*near)(void *owner, double time, const double *x, const double *solutions, double *slope, double *found);
                                 /* the derivatives of the states, no numbers where there are none, and the solutions of
                                    blocks found from some nearby; another status than 0 halts */
  const double *gauss;           /* nodes, matrix, weights of Gauss's method, of fewer stages and of all */
  double *times, *states, *solutions; /* (places,), (places, n), (places, m) */
  double *slopes, *slope, *rates, *curvature, *end, *x, *sought, *found;
  int64_t halted;
} lmoc_passage;

/* Lay out the memory behind `at`; how many numbers it takes where that is 0. */
int64_t lmoc_passage_lay_out(lmoc_passage *p, double *at);

/* Find a step of some width from the place that stands first, with the singular one in its middle, to a state that is known
   within tolerances (n,). 0 where it cannot be trusted. */
int lmoc_passage_find(lmoc_passage *p, double width, const double *tolerance);

/* The state and the solutions at a time within it, by the polynomial through all places. */
void lmoc_passage_at(lmoc_passage *p, double time, double *x, double *solutions);

/* The values at a time of polynomials, each 1 at its own place and zero at the others. */
void lmoc_lagrange(int64_t count, const double *places, double time, double *weights);

/* From which times within a passage of some width, with which weights, values at a time are made up: beside a singular place
   they are 0/0, and the limit of those around it (cubic, symmetric). Returns how many there are, 1 or BESIDE. */
int lmoc_passage_beside(double time, double singular, double width, double *times, double *weights);

#endif
