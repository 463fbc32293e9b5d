/* Which coordinates of a mechanism are its states: how well that choice serves along a motion, and which would be better.

   Constraints A*dq_dependent + B*dq_state = 0 stand in a matrix (rows, columns) by rows, A in front. */

#ifndef LMOC_COORDINATES_H
#define LMOC_COORDINATES_H

#include "engine.h"

/* As `numerics/coordinates/limits.py` describes them, in its order. */
typedef struct {
  double margin, tolerated, good, unexplained, neighbours, rounding, at_once, turned, alert, sure, dependent, share, vanishing, grown,
         normal, no_entry;
} lmoc_coordinate_limits;

/* Factors with which rows and columns of entries (count,) of these sizes have one length, and the largest share of each
   column in a row, by its unit (columns,). `again` where those of sizes a little smaller stand there. `work` is (3 rows,
   3 columns, count). */
void lmoc_equilibrate(const lmoc_coordinate_limits *by, int64_t rows, int64_t columns, int64_t count, const int32_t *place,
                      const double *size, const double *units, int again, double *row, double *column, double *range,
                      double *work);

/* Bring the rows of entries (count,) to one size at a place, with coordinates in units (columns,): in metres lengths would be
   as large beside the angles of a small mechanism as it is small, whatever its position. `work` is (rows,). */
void lmoc_rows_of_one_size(int64_t rows, int64_t columns, int64_t count, const int32_t *place, const double *units,
                           double *entries, double *work);

/* The columns that are the states after the dependent coordinates have been chosen anew, by elimination with full
   pivoting, first in `held` (columns,); 0 where the rows depend on each other, or where they are the present ones. `matrix` is
   equilibrated, and overwritten. */
int lmoc_states_by_pivots(const lmoc_coordinate_limits *by, int64_t rows, int64_t columns, double *matrix, int32_t *held);

/* The columns that are the states, (2, states), behind exchanges that lead to a good choice: all of them, and the first and
   best alone. Returns how many of the two there are. `table`, `barred`, `dependent` (rows,) and `held` are overwritten. */
int lmoc_exchanges(double good, int64_t rows, int64_t states, double *table, uint8_t *barred, int32_t *dependent,
                   int32_t *held);

/* What is asked about a place k, and another one where two are compared. All but VALUES where constraints are seen block by
   block alone: then VALUES are all numbers of a place, else its matrix, coordinates and solutions. Answers stand in
   `answer`; a status other than 0 halts what is under way. */
enum { LMOC_VALUES, LMOC_REGULAR, LMOC_VANISHES };

/* What a judgement comes to. */
enum { LMOC_SERVE, LMOC_WORSE };

enum { LMOC_PLACES = 6, LMOC_PLACE_HEAD = 4 };

/* The coordinates of one motion, and the places that it has come to: each its time, the sign of the determinant of A, what
   the smallest singular value is not below, that value (no number as long as nobody has asked); then the matrix (count,),
   the tableau (watched, states), the coordinates (told,), solutions of nonlinear blocks (solved,), states (n,). */
typedef struct {
  lmoc_coordinate_limits by;
  int64_t rows, columns, watched, count, told, solved, n;
  int64_t blocks;                /* constraints are seen block by block: `ask` knows how */
  int64_t ranked;                /* whether constraints may not come to depend on each other */
  const int32_t *row;            /* (watched,) dependent coordinates that change along the motion */
  const double *units;           /* (columns,) of coordinates: 1 for angles, 1 or what suits a mechanism's size for lengths */
  const uint8_t *barred;         /* (watched,) 1 for those that cannot be states */
  void *owner;
  int (*ask)(void *owner, int what, double time, const double *x, int64_t k, int64_t other);
  double limit, alert, singular, answer, recent_least;
  int64_t accepted, last, lost_rank, inside, equilibrated, halted, paced;
  double *places, *size, *bound, *row_factor, *column_factor, *range, *recent, *apart, *pace, *work;
  int32_t *place;                /* (count,) */
} lmoc_coordinates;

/* Lay out the memory, all zero, behind `at`; how many numbers it takes where that is 0. */
int64_t lmoc_coordinates_lay_out(lmoc_coordinates *c, double *at);

/* Judge the place where a motion begins; with entries compared with the sizes that stand there. */
int lmoc_coordinates_begin(lmoc_coordinates *c, double time, const double *x);

/* Judge a step to a place from the one accepted last, and accept it where coordinates serve. */
int lmoc_coordinates_judge(lmoc_coordinates *c, double time, const double *x);

double lmoc_coordinates_margin(lmoc_coordinates *c, int64_t k);        /* smallest singular value */
int lmoc_coordinates_vanish(lmoc_coordinates *c, int64_t k);           /* whether the rest does not follow from the states */
int lmoc_coordinates_passed(const lmoc_coordinates *c);  /* the last step has led over a place where it does not follow */
void lmoc_coordinates_tolerate(lmoc_coordinates *c);     /* take those of the last place for as good as they can be */

/* The longest step with which to go on from where the last one has begun, and until when, where no others are better: on the
   way to a place where constraints depend on each other until it is twice as near. 0 where shorter steps do not help.
   `stalled` is how often it has gone on from there; `span` that of the run. */
double lmoc_coordinates_shorter(lmoc_coordinates *c, int64_t stalled, double span, double *until);

/* No step was short enough: look back at the place accepted last. Returns whether constraints depend on each other there, their
   smallest singular value being below so much. */
int lmoc_coordinates_stuck(lmoc_coordinates *c, double below);

/* Which of the watched coordinates follows least from the states at the last place. */
int64_t lmoc_coordinates_lost(const lmoc_coordinates *c);

/* The place accepted last: the sign of the determinant of A; its time, its state, and the solutions of blocks there. */
double lmoc_coordinates_sign(const lmoc_coordinates *c);
const double *lmoc_coordinates_accepted(const lmoc_coordinates *c, double *time, const double **x);

/* Better choices, best first: (2, states) columns. Returns how many there are. */
int lmoc_coordinates_better(lmoc_coordinates *c, int32_t *held);

/* What tells the values of a place without Python, and judges steps that are certainly good (`lmoc_step_hook`). */
typedef struct {
  lmoc_coordinates *by;
  void *call;                             /* the system, with what evaluates it … */
  int (*evaluate)(void *call, double time, const double *x);
  void (*mark)(void *call);               /* … and marks where it has been solved last */
  const double *registers;                /* of the system */
  double *w;                              /* registers from which the entries follow */
  const lmoc_tape *tape;
  int64_t read_count, entry_count;
  const int32_t *reads, *entry, *target;  /* registers that the tape reads; those of entries, and where each is added */
  const int32_t *told, *solved;           /* registers of coordinates, of unknowns of blocks */
  double *record;                         /* (room, 1 + n + solved) times, states, solutions of steps; or 0 */
  int64_t kept, room;
} lmoc_step_watch;

int lmoc_step_watch_values(void *own, int what, double time, const double *x, int64_t k, int64_t other);
double lmoc_step_watch_margin(lmoc_step_watch *s, double time); /* the smallest singular value where the registers stand */
int lmoc_step_watch_look(void *own, double time, const double *x, int first);
void lmoc_step_watch_keep(void *own);

#endif
