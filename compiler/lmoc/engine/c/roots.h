/* Location of sign changes of functions of time within a step, in order. */

#ifndef LMOC_ROOTS_H
#define LMOC_ROOTS_H

#include <stdint.h>

/* What a step comes to; halted by a hook. */
enum { LMOC_NO_ROOT, LMOC_ROOT, LMOC_ROOTS_HALTED, LMOC_ROOTS_NO_MEMORY };

/* Functions, and how far a step has been looked at. */
typedef struct {
  int64_t count;
  double *signs;           /* (count,) that they have had last; 0 where none is known yet */
  uint8_t *which;          /* (count,) those that vanish at the root found last */
  void *owner;             /* of the functions: 0 where they are good */
  int (*values)(void *owner, int64_t count, const double *times, double *values); /* (count of times, functions) */
  int (*quiet)(void *owner, double time, const double *heights, uint8_t *out);    /* those that are no higher than so
                              much in a step, and zero but for rounding: they have no roots. Or 0 */
  double before, end;      /* s, of the step */
  double begin, length, shortest; /* s, from where on it is looked at, by which part */
  int64_t inside;          /* samples at equal distances in a part */
  double *memory;          /* of the samples */
  int64_t room;
} lmoc_finder;

/* Begin with a step. */
void lmoc_roots_of_step(lmoc_finder *f, double before, double end);

/* The next root of the step; `signs` are those behind it. */
int lmoc_next_root(lmoc_finder *f, double *time);

void lmoc_roots_free(lmoc_finder *f);

/* A function of time, below zero in the end. */
typedef int (*lmoc_curve)(void *own, int64_t count, const double *times, double *values);

/* Where it is lowest between two times, by golden sections; where below zero, at once. */
int lmoc_lowest(lmoc_curve curve, void *own, double a, double b, double *time, double *value);

/* The same between the neighbours of that one of some times at which it is lowest. */
int lmoc_lowest_about(lmoc_curve curve, void *own, int64_t count, const double *times, double *time, double *value);

/* The end at which it is below zero of the smallest bracket of its crossing, between a, at which it is at_a >= 0, and b,
   at which it is at_b < 0. `near` (points,) are known values around, at increasing times; or none. */
int lmoc_locate(lmoc_curve curve, void *own, double a, double b, double at_a, double at_b, int64_t points,
                const double *near_times, const double *near_values, double *time);

#endif
