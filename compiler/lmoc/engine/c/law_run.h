/* The laws of one run on its way: the mode that holds, what ends it, and what happens there. */

#ifndef LMOC_LAW_RUN_H
#define LMOC_LAW_RUN_H

#include "transition.h"

enum { LMOC_SERIES = 3 };     /* impacts by which the end of a series is known */
enum { LMOC_CHANGES = 500 };  /* changes of laws within a moment that are chattering */

/* What an instant is for a law. */
enum { LMOC_NO_EVENT, LMOC_ACCUMULATION, LMOC_IMPACT, LMOC_CLOSING, LMOC_OPENING };

/* Why there is no way, beside those of `kinematics.h`: a gap is negative that no motion has closed; one that is closed
   jumps below zero; laws open and close without end; laws and discrete equations change each other without end. */
enum { LMOC_OVERLAPS = 5, LMOC_GAP_JUMPS = 6, LMOC_CHATTERS = 7, LMOC_NO_END = 8 };

/* s: where the first mode was found, where the present segment begins, where laws have opened last. */
typedef struct {
  double begun, now, let_go;
  int64_t changes;
} lmoc_law_times;

typedef struct {
  lmoc_kinematics k;
  const lmoc_flag *curved;     /* (2, n) gaps and rates that integrators keep within their errors alone */
  const lmoc_flag *linear;     /* (n,) rates that are linear in the states, with coefficients that never change */
  const lmoc_flag *position;   /* (states,) those that no law can hold */
  const double *limits;        /* (n,) sticking limits that are parameters; no number for others */
  const double *noise;         /* (n,) what levels are by rounding alone */
  int64_t work, heat;          /* which states of the ledger they are; -1: none */
  double moment;               /* s, within which laws chatter */

  /* The mode (`numerics/problem/mode.py`), and what goes with it: one piece of memory. */
  lmoc_law_times *times;
  int64_t *direction;
  double *push, *force, *idle; /* idle: roots in sequence at which nothing has happened */
  double *rounding;            /* (states,) of their rates, by the forces that hold there */
  double *forms;               /* (n, states) rates that are linear forms in velocities; no numbers for others */
  double *impacts, *changes;   /* s, the latest of each law (n, LMOC_SERIES), and of all */
  double *left;                /* rates behind the last impact of each; 0: none, or at rest */
  double *apart;               /* (2 n,) what keeps roots from being noticed at once; those of what sticks behind the others */
  int64_t *turning;            /* of the last trigger … */
  lmoc_flag *opening, *closing;
  lmoc_flag *closed, *implied, *touched;
  lmoc_flag *held;             /* (states,) velocities that the closed laws keep at zero */

  /* What has happened last. */
  int64_t *kind;
  double *when, *impulse, *lost, *level;
  lmoc_flag *was, *is, *passing, *accumulated, *undecided;
  lmoc_flag *laws;             /* those that contradict each other; or the one whose gap is wrong */
  double until;
  int64_t law, some;           /* of impact, as in `transition.h`; whether anything has happened */

  lmoc_contact now, past, spare;  /* where the segment begins; `past` for `lmoc_law_parts`; scratch */
  lmoc_settled next;
  double *root, *inputs;       /* (2 n,), (2, 3, n) */
  lmoc_flag *none;             /* (2 n,) */
} lmoc_law_run;

/* The discrete equations of the same scene, and who carries them out. Functions return 0 where an answer is good. */
typedef struct {
  void *owner;
  int (*renew)(void *owner);      /* the laws are judged with the present discrete values from here on */
  int (*happened)(void *owner);   /* tell of the laws, with whose mode the discrete equations are judged from here on */
  int (*settle)(void *owner, double time, double *x);  /* carry them out; they may move the states */
} lmoc_discrete;

/* Lay out its memory, `count` doubles, or say how many with no place. All laws are open then. */
int64_t lmoc_law_place(lmoc_law_run *s, double *memory);
void lmoc_law_open(lmoc_law_run *s);

/* Parameters have been set. */
int lmoc_law_renew(lmoc_law_run *s);

/* Functions that are positive as long as the mode holds, and their values from what is read (`switching.h`): one a law,
   and behind them one more for each that sticks. */
int64_t lmoc_law_values(const lmoc_law_run *s, int64_t count, const double *read, double *out);

/* A segment begins here, where the quantities of `lmoc_law_values` are these, (4 n). */
void lmoc_law_watch(lmoc_law_run *s, const double *read);

/* What happens; `x` (states,) is moved to what follows. LMOC_SOLVED, or why there is no way. `which` (2 n): the functions
   that vanish; `jumped`: the states have been changed from outside. */
int lmoc_law_start(lmoc_law_run *s, double time, double *x);
int lmoc_law_happen(lmoc_law_run *s, double time, double *x, const lmoc_flag *which, int jumped);

/* Go on in a mode that has been set, from a place. `anew`: whether what touches there is found anew. */
int lmoc_law_go_on(lmoc_law_run *s, double time, const double *x, int anew);

/* Let laws and discrete equations answer each other until nothing changes: from the states as the laws have left them
   `before`, and as they are now. */
int lmoc_law_settle(lmoc_law_run *s, const lmoc_discrete *d, double time, double *before, double *x);

/* Whether a value that jumps changes any motion of the laws: look before and after it. */
int lmoc_law_look(lmoc_law_run *s, double time, const double *x);
int lmoc_law_parts(lmoc_law_run *s, double time, const double *x, int *found);

/* States that a step has moved from `before`, with the impulses of closed laws that keep them closed: these do not bounce
   on the way of a step that does so ever faster. */
int lmoc_law_strike(lmoc_law_run *s, double time, const double *before, double *x);

/* Move a state onto what is closed, where it is off by more than a share of the terms. */
int lmoc_law_keep(lmoc_law_run *s, double time, double share, double *x);
int lmoc_law_drifts(const lmoc_law_run *s);   /* whether anything is closed that may */

/* The registers of the switched form in this mode, (3, n), as of `lmoc_mode_input`. */
void lmoc_law_inputs(const lmoc_law_run *s, double *out);

#endif
