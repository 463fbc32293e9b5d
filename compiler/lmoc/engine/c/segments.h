/* Segments of a run along Taylor series, each of which laws or events end: one after the other, with nobody else in
   between. What is not as usual is left to who looks more closely (`numerics/run/segments.py`): it finds all as it was
   where that segment has begun. */

#ifndef LMOC_SEGMENTS_H
#define LMOC_SEGMENTS_H

#include "book.h"
#include "law_run.h"
#include "step_functions.h"
#include "taylor.h"

/* A program that is given the registers which stay as they are during a segment. */
typedef struct {
  double *w;
  const lmoc_tape *tape;
  int64_t blocks;
  lmoc_call *call;             /* of those that remember a solution; or 0 */
} lmoc_given;

/* Memory that is put back where a segment is left to others. */
typedef struct {
  double *at;
  int64_t count;
} lmoc_kept;

typedef struct {
  const lmoc_taylor *taylor;
  lmoc_walk *walk;             /* with its tolerances and memory */
  lmoc_call *rates;            /* of the same states */
  const lmoc_watched *watched; /* what tells the end of a mode, or zero functions of events; or 0 */
  lmoc_law_run *laws;          /* or 0 */
  double *memory;              /* (size,) of the laws */
  int64_t size;
  double *errors, *unresolved; /* (states,) of the laws: what a step is wrong by, and what it tells apart by no more */
  lmoc_book *book;             /* of the events; or 0 */
  const int32_t *discrete;     /* registers of their discrete values */
  int64_t pieces;
  const lmoc_kept *piece;      /* (pieces,) what they know */
  double shortly;              /* s, within which a function that crosses zero again may not have left it */

  const double *open;          /* (registers,) that stay as they are, with all laws open */
  int64_t registers, shown;
  const int64_t *numbers, *places; /* (shown,) of the mode's inputs, and in which registers they stand */
  const int64_t *held;         /* (states,) registers that say so of a velocity; -1: none */
  int64_t programs;
  const lmoc_given *program;

  double begin, end, last;     /* s: of the run; when something has happened last */
  double time, *x;             /* where it stands */
  const double *times;         /* output times, and the states at them, (outputs, states) */
  int64_t outputs, first, reached; /* first: of the segment, of those reached */
  double *out;
  int64_t most;                /* steps of a segment */
  int64_t functions;           /* at the most */
  double *work;                /* 7 states, 6 functions, 2 of what is read, and all pieces */

  /* What has been: of each segment, and of the laws at its beginning; `room` segments. */
  int64_t room;
  double *base, *largest, *states, *ended, *kept; /* (room, registers), (room, states) and those behind it, (room,),
                                                 (room + 1, size + 2) */
  int64_t *until, *booked;     /* (room,) output times, and numbers of the book, up to its end */
  int64_t steps, tries, evaluations;
} lmoc_segments;

/* Go on as far as possible; returns how many segments there have been. */
int64_t lmoc_segments_go(lmoc_segments *s);

#endif
