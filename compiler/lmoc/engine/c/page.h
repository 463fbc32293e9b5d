/* A scene of a page: registers, programs over them, and steps, for a host that knows numbers only (WebAssembly). */

#ifndef LMOC_PAGE_H
#define LMOC_PAGE_H

#include "bytes.h"
#include "roots.h"
#include "walk.h"

typedef struct lmoc_page lmoc_page;

/* Where so many bytes can be put; room for so many more without the memory's growing (`page_memory.c`), 0 where there is
   none; and the scene that stands in bytes, as `view/javascript/programs.py` describes it; 0 where that fails. It lives as
   long as the host. */
uint8_t *lmoc_page_room(int size);
int lmoc_page_reserve(int size);
lmoc_page *lmoc_page_new(const uint8_t *bytes, int size);

/* Where the host finds numbers: all registers; a state, which it writes, and derivatives or another state, which it reads;
   absolute tolerances, which it writes. */
double *lmoc_page_registers(lmoc_page *p);
double *lmoc_page_state(lmoc_page *p);
double *lmoc_page_answer(lmoc_page *p);
double *lmoc_page_tolerances(lmoc_page *p);

/* Run a program as the registers stand; and for the state at a time, with signals, and nonlinear blocks near their last
   solution. Both return the bits FAILED and FAR. */
int lmoc_page_run(lmoc_page *p, int program, double time);
int lmoc_page_evaluate(lmoc_page *p, int program, double time);
void lmoc_page_sample(lmoc_page *p, double time);

/* Parameters have changed; nonlinear blocks begin from the registers. */
void lmoc_page_forget(lmoc_page *p);
void lmoc_page_seed(lmoc_page *p);

/* Derivatives of the state. */
void lmoc_page_rates(lmoc_page *p, double time);

/* Steps from the state at a time; `first` is their first length, or 0. What a step returns is that of `lmoc_dop853_walk`: 0,
   or STIFF, where it has been made. Its dense output has to be good at the time `wanted`. */
void lmoc_page_begin(lmoc_page *p, double time, double end, double rtol, double longest, double first, double patience);
int lmoc_page_step(lmoc_page *p, double wanted);

/* Go on with an implicit method to these tolerances; 0 where there are too many states. */
int lmoc_page_stiffen(lmoc_page *p, double rtol);

/* Its numbers: time, where it began, the next length, rejected tries, evaluations so far. */
double lmoc_page_told(const lmoc_page *p, int which);

/* The state at a time within the last step; 0 where there is none. And another state at its end to go on from. */
int lmoc_page_within(lmoc_page *p, double time);
void lmoc_page_jump(lmoc_page *p);

/* Functions whose change of sign ends a piece that begins with the state: how many; the signs
   that they begin with, 0 where it is that of their value; their values for a state. */
int lmoc_page_roots(lmoc_page *p, double time);
double *lmoc_page_sides(lmoc_page *p);
double *lmoc_page_root_values(lmoc_page *p, double time);

/* Follow them from the state at a time on. The time within the last step at which one of them comes to have another sign, where
   the answer is the state: infinity where none does, -infinity where there are no values, NaN where there is no memory. */
void lmoc_page_follow(lmoc_page *p, double time);
double lmoc_page_root(lmoc_page *p);

/* Room for a square matrix, by rows, with a right side behind it, all zero; no place where there is none. And the shortest vector
   that comes nearest to it, where singular values up to a share of the largest one count as none. */
double *lmoc_page_matrix(lmoc_page *p, int order);
double *lmoc_page_least_squares(lmoc_page *p, double share);

/* Events. What they ask and change stands in the state; what it comes to is that of an instant, or of hops. `told` are numbers
   of conditions of which something is to be said. */
void lmoc_page_begin_events(lmoc_page *p, double time, double span);
void lmoc_page_start_events(lmoc_page *p, double time);    /* the answer is the state behind what happens at the start */

/* Of the latest event: the next time event; what it is called: when 0, time 1, terminal 2, start 3; and what energy the jump of
   states has cost. The answer is the state behind it. */
double lmoc_page_happened(const lmoc_page *p, int which);
double *lmoc_page_before(lmoc_page *p);                     /* (discrete,) values before it */
int lmoc_page_told_count(const lmoc_page *p);
int lmoc_page_told_of(const lmoc_page *p, int k);

/* Steps of inputs whose derivatives the equations hold: room for the times at which some step, in order, in a run that begins
   at a time; the next of them; and what they do at one, with all laws open: the answer is the state behind it. 0, 1 where
   there are no values, below -100 why laws leave no way, and else a status of `jump.h`, as a number below zero. */
double *lmoc_page_step_times(lmoc_page *p, int count, double begin);
double lmoc_page_next_step(const lmoc_page *p);
int lmoc_page_input_steps(lmoc_page *p, double time);

/* Of what has stepped last: which that may step is the first; from and to what; whether the states have moved; and whether the
   source has done work beyond all bounds. */
double lmoc_page_stepped(const lmoc_page *p, int which);

/* Laws. Registers with all of them open, and as the mode that holds says; what happens is 0 or why there is no way, as of
   `law_run.h`, and the answer is the state behind it. */
void lmoc_page_begin_laws(lmoc_page *p, double moment);
void lmoc_page_open(lmoc_page *p);
void lmoc_page_hold(lmoc_page *p);
double *lmoc_page_errors(lmoc_page *p);
int lmoc_page_start_laws(lmoc_page *p, double time);
int lmoc_page_laws_happen(lmoc_page *p, double time);

/* Laws have left this state, with the discrete values before an event; and behind it, let laws and discrete equations answer
   each other from the state as it is now. The host is told of each. */
void lmoc_page_left(lmoc_page *p);
int lmoc_page_settle(lmoc_page *p, double time);

/* All that follows where a piece has ended with the state, at a root of the functions or not, in a run that began at a time: 0,
   OVER at its end, or why laws leave no way. The answer is the state behind it, at the time of the instant. The host is told
   of each thing that happens. */
int lmoc_page_after(lmoc_page *p, double ended, double begin, int root);
double lmoc_page_instant(const lmoc_page *p);

int lmoc_page_laws_drift(const lmoc_page *p);
int lmoc_page_keep(lmoc_page *p, double time, double share);

/* A number of a law: closed, implied, direction, push; kind, when, impulse, lost, was, is of what has happened last; whether
   it contradicts others; its gap; the law of impacts; whether it is a complementarity. */
double lmoc_page_law(const lmoc_page *p, int k, int which);

/* The choice of coordinates, watched from the state on, where what one has come to before in the same coordinates is kept if it
   is `onward`; `sizes` are those of the entries of the constraints, (rows, columns), with which they are compared. Whether it
   serves, there and at the end of a step: 0; 1 where others are better by a margin, 2 where the step has passed a place where
   it does not serve, 3 where constraints come to depend on each other, or do so where no step was short enough. */
double *lmoc_page_sizes(lmoc_page *p);
int lmoc_page_watch(lmoc_page *p, double time, int onward);
int lmoc_page_judge(lmoc_page *p, double time);
int lmoc_page_stuck(lmoc_page *p);
int lmoc_page_determines(lmoc_page *p);                     /* whether the rest follows at all at the last place accepted */
int lmoc_page_lost(const lmoc_page *p);                     /* which watched coordinate follows least at the last place */

/* Have nonlinear blocks go on from their solutions at the last place accepted. Better choices, best first, as columns that are
   the states: how many, and where they stand. And where there are none, the longest step with which to go on, 0 where that is
   none, and until when. */
void lmoc_page_stand(lmoc_page *p);
int lmoc_page_better(lmoc_page *p);
int32_t *lmoc_page_held(lmoc_page *p);
int lmoc_page_tolerate(lmoc_page *p);                       /* … 1 where they are worse than a run may begin with */
double lmoc_page_shorter(lmoc_page *p, int stalled, double span);
double lmoc_page_until(const lmoc_page *p);

/* The passage over the place where constraints depend on each other, to a state known within the absolute tolerances and no
   longer than so much: when it ends, no number where there is none that can be trusted. The state there at a time is the
   answer, at which nonlinear blocks stand then; and of what times and weights, (2, count), values there are made up. */
double lmoc_page_pass(lmoc_page *p, double longest);
void lmoc_page_over(lmoc_page *p, double time);
int lmoc_page_beside(lmoc_page *p, double time);
double *lmoc_page_weights(lmoc_page *p);

/* What laws and events stand at, as numbers that the host hands to the same scene in other coordinates, which goes on there
   from the state at a time: 0, or why laws leave no way. */
int lmoc_page_carried_count(lmoc_page *p);
double *lmoc_page_carried(lmoc_page *p);
int lmoc_page_adopt(lmoc_page *p, double time);

#endif
