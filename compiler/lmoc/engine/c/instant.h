/* What happens at instants: relations, discrete equations, samples, `reinit`, and their iteration. With the values pre(v)
   fixed, all equations are solved for the values v, the continuous ones for given discrete values and the other way
   round, in turn until nothing changes; and again with pre(v) := v until no event follows (Modelica specification 3.6, 8.6
   and appendix B). */

#ifndef LMOC_INSTANT_H
#define LMOC_INSTANT_H

#include "tape.h"

enum { LMOC_GT, LMOC_GE, LMOC_FLOOR };  /* how relations are decided */
enum { LMOC_ROUNDS = 100, LMOC_BEGUN = LMOC_ROUNDS, LMOC_BEFORE, LMOC_HISTORY };
/* What an instant comes to: no values of the continuous equations; none of the discrete ones; or a hook has ended it. */
enum { LMOC_SETTLED, LMOC_NO_VALUE, LMOC_HALTED, LMOC_UNSETTLED };

/* The scene, what it stands at, and who is asked. Places are those of `v`, the memory of the tape of discrete equations;
   zero functions whose relations are of time alone have none, but a line. */
typedef struct lmoc_instant {
  int64_t states, discrete, zeros, relations, before, samples, reinits, told, bounded, assigned;
  const int32_t *own;                      /* (discrete,) places */
  const int32_t *op, *target, *row;        /* (relations,) place of the value; zero function, or -1 - its line */
  const int32_t *of_zero;                  /* (zeros,) the relation of each */
  const int32_t *slope, *offset, *written; /* (lines,) places in `line`: slope·time + offset, and as it is written */
  const int32_t *now, *past, *held;        /* (before,) places; whether `now` is discrete itself */
  const int32_t *sample, *start, *interval;
  const int32_t *guard, *state, *value;    /* (reinits,) places; which state, or -1 */
  const int32_t *tell, *sought;            /* (told,) places of conditions; of which value something is said, 0 or not 0 */
  const int32_t *read;                     /* (bounded,) places of what `bounds` depends on */
  const int32_t *filled, *first_used, *used; /* (assigned,) places that discrete equations fill, and which those are that
                                              each of them reads */
  const lmoc_tape *assign, *lines;
  double *v, *line;
  double *zero, *margin, *largest, *high;  /* (zeros,) values as last looked at; how far a function that has just crossed
                                              zero may come back by rounding; largest values and heights since */
  double *crossed;                         /* (zeros,) 1 + the value of the relation behind it, where that is the event */
  double *bound, *way, *known;             /* (zeros,) rounding; (states,) and (bounded,) with which it has been found */
  double *supposed, *early;                /* (relations,) whose values are being tried; that are as right before */
  double *changed, *flipped;               /* (discrete,) in the last turn; in any of them */
  double *moved, *history;                 /* (states,); (LMOC_HISTORY, discrete) */
  uint8_t *near;                           /* (zeros,) */
  int64_t *found;                          /* (told,) what is to be told, in order; and how much that is */
  int64_t found_count, literal, supposing, jumped, bound_known;
  double time, bound_time, bound_size;
  void *owner;
  int (*look)(struct lmoc_instant *e, double time, const double *x);  /* `zero`, and what is continuous in `v`; 0 where it is good */
  int (*widen)(struct lmoc_instant *e, double time, const double *x); /* margins of what is zero but for rounding */
  int (*bounds)(struct lmoc_instant *e, double time, const double *x);    /* `bound` and with what; or 0 */
  int (*others)(struct lmoc_instant *e, double time, const double *x);    /* values repeat each other: find some that agree */
  int (*regular)(struct lmoc_instant *e, double time, const double *x);   /* others where a block is singular; or 0 */
  int (*move)(struct lmoc_instant *e, const double *x, int64_t reinit, double wanted, double *moved);
  int (*follow)(struct lmoc_instant *e, const double *x, double *moved);  /* have other states follow those moved; or 0 */
} lmoc_instant;

static inline double lmoc_near_to(double t) { return 4e-15 * fmax(fabs(t), 1e-300); }
/* By what the place of a root may be wrong: some units of the time's last digit, and of a sum of steps. */
static inline double lmoc_located(double t, double start) { return 1e-14 * fmax(fabs(t), fabs(start)) + 1e-12 * (t - start); }
static inline int lmoc_differ(double a, double b) { return a != b && !(a != a && b != b); }

/* Relations and their zero functions (`relations.c`). */
int lmoc_rounded(const lmoc_instant *e, int64_t zero);      /* its whole part counts, not its sign */
double lmoc_height(const lmoc_instant *e, int64_t zero, double value); /* its distance from zero, or a whole number */
double lmoc_decide(int op, double zero);
void lmoc_relations(lmoc_instant *e);                       /* all of them */
int64_t lmoc_roots(const lmoc_instant *e);                  /* how many functions change sign where something happens … */
void lmoc_root_values(const lmoc_instant *e, const double *zero, double *out); /* … their values … */
void lmoc_root_sides(const lmoc_instant *e, double *out);   /* … and the sides on which they are, -1 or 1 */
void lmoc_seen(lmoc_instant *e, const double *zero);        /* at a place of a step … */
void lmoc_followed(lmoc_instant *e);                        /* … which has been looked at */
void lmoc_follow(lmoc_instant *e, int64_t count, const double *zero, double *out); /* all that at several places */
void lmoc_turn_early(lmoc_instant *e, const double *which); /* functions that are about to cross zero; 2: upwards */
void lmoc_leave_zero(lmoc_instant *e, const double *which); /* … that have crossed it */
int lmoc_rounding(lmoc_instant *e, double time, const double *x);   /* bring `bound` up to date */
int lmoc_widen(lmoc_instant *e, double time, const double *x);    /* margins by `bounds` */
int lmoc_quiet(lmoc_instant *e, double time, const double *x, const double *height, uint8_t *out); /* no more than that */

/* Instants (`instant.c`). */
int lmoc_take(lmoc_instant *e, double time, const double *x);       /* the continuous values at a place */
void lmoc_remember(lmoc_instant *e);                        /* pre(v) := v */
void lmoc_assign(lmoc_instant *e);                          /* the discrete equations once, in their order */
int64_t lmoc_turn(lmoc_instant *e, const double *x);        /* both; how many have changed, -1 without values */
int lmoc_solve_instant(lmoc_instant *e, const double *x);          /* discrete values that agree with the continuous ones */
int lmoc_reinit(lmoc_instant *e, const double *x, int *some);       /* `moved`: the states with their new values */
int lmoc_event(lmoc_instant *e, double *x);                 /* all that follows from what has been set */
double lmoc_next_time(lmoc_instant *e, double time, int include);   /* s, of the next time event; at the time itself? */
void lmoc_ring(lmoc_instant *e, double time);               /* the samples whose instant this is */

/* Values of relations that are tried, those with the fewest changes first (`trials.c`): `begun` (discrete,) with at most
   so many of some relations changed, those of `zeros`, whose values all equations then agree with; and `accept`, or 0.
   LMOC_UNSETTLED where there are none among the first `trials`. */
int lmoc_try(lmoc_instant *e, const double *x, const double *begun, int64_t count, const int64_t *zeros, int64_t most,
             int64_t trials, int (*accept)(lmoc_instant *e, double time, const double *x));
/* The functions of relations that the equations of what has changed read, (discrete,); how many, -1 without memory. */
int64_t lmoc_zeros_read(const lmoc_instant *e, const double *changed, int64_t *zeros);
/* As `others`: those that flip, in all combinations; then a few of all those in the equations of what has changed, since
   one that does not flip may be what keeps the others from agreeing. */
int lmoc_try_relations(lmoc_instant *e, double time, const double *x);

/* A program that looks at a place, with the discrete values in registers of it. */
typedef struct {
  double *w;
  const lmoc_tape *tape;
  int64_t blocks;
  lmoc_block *block;
} lmoc_looking;

/* What `look` does where no block is nonlinear: discrete values into the registers of a program, values out of them. And
   the same for the motion. */
typedef struct {
  lmoc_looking at, along;
  int64_t seen;
  const int32_t *states, *given, *zero;    /* registers of states, discrete values, zero functions, … */
  const int32_t *rates, *from, *to;        /* … of the states' rates; (seen,) … what is seen; its places */
} lmoc_view;

/* The owner is a view. */
int lmoc_look_at(lmoc_instant *e, double time, const double *x);
int lmoc_look_along(lmoc_instant *e, double time, const double *x, double *rates, double *zeros);

#endif
