/* What a scene of a page consists of. */

#ifndef LMOC_PAGE_SCENE_H
#define LMOC_PAGE_SCENE_H

#include "beside.h"
#include "coordinates.h"
#include "dense.h"
#include "free_dynamics.h"
#include "happen.h"
#include "jump.h"
#include "law_run.h"
#include "page.h"
#include "passage.h"
#include "radau.h"
#include "roots.h"
#include "tables.h"

/* A program, and the scene whose signals it reads: the interpreter is given its tape. */
typedef struct {
  lmoc_program program;
  lmoc_page *page;
} scene_program;

/* The events of a scene: the memory of the discrete equations are the registers. */
typedef struct {
  lmoc_instant instant;
  lmoc_hops hops;
  lmoc_events way;
  int64_t look;                       /* the program of the zero functions */
  int64_t stored, work_state, heat_state; /* registers and states, -1: none */
  const int32_t *zero, *seen;         /* (zeros,), (reinits,) registers */
  double *work, *noise, *now;         /* room */
  double *left, *state, *past;        /* (n,), (n,), (discrete,) as laws have left them; room */
  double *errors;                     /* (n,) what the method has allowed itself in its last step */
  double next, turned, lost;          /* s, of the next time event and of the last one that has changed the motion; J, that
                                         the last event has cost */
} page_events;

/* What steps while the equations hold derivatives of it. */
typedef struct {
  lmoc_jump jump;
  int64_t look, rates;                /* programs: what may step, and the energy stored; the rates where some are given */
  int64_t stored, work, count;        /* register and state, -1: none; how many may step */
  const int32_t *registers;           /* (given,) those that may step first */
  const int32_t *which, *value, *own, *results; /* (given,) and the results' registers */
  const int32_t *early;               /* relations that are at the start what they were right before */
  int64_t early_count;
  double *w;                          /* registers of its own */
  double *seen, *sides, *old, *change, *moved, *before;
  double *times, begin;               /* s, at which inputs step; where the run began */
  int64_t time_count, passed, first;  /* … which of what has stepped is the first */
  int some, unbooked;                 /* whether it has moved the states; beyond all bounds */
} page_jumps;

/* Its laws. */
typedef struct {
  lmoc_law_run run;
  lmoc_free_dynamics free;
  int64_t by_force, roots;            /* programs: the quantities with their derivatives; what ends a mode */
  const lmoc_flag *limited;           /* (n,) whose sticking limits are parameters */
  const int32_t *restitution_of, *held; /* registers; -1: none */
  const int32_t *read;                /* (4 n,) of motions, rates, forces, sticking limits */
  double *inputs, *restitution, *errors, *unresolved, *known, *values, *limits;
  lmoc_flag *which;
} page_laws;

/* Its choice of coordinates, where constraints change along the motion. */
typedef struct {
  lmoc_coordinates judge;
  lmoc_step_watch watch;
  lmoc_passage passage;
  int64_t program;                    /* the entries of the constraints */
  double until, singular;             /* when steps are no longer to be shorter; when the last passage is singular */
  double beside[2*LMOC_BESIDE];       /* times and weights of places on it */
  int32_t *held;                      /* (3 columns,) */
  double *carried;                    /* what laws and events go on with in other coordinates */
} page_coordinates;

struct lmoc_page {
  scene_program *programs;
  lmoc_tables tables;
  int64_t program_count, size, n, unknown_count, right, branches;
  int32_t *states, *derivatives, *unknowns;
  double *w, *x, *answer, *atol, *f, *begin;
  int64_t dense, rejected, evaluations;
  int switched;
  const lmoc_call *last;
  lmoc_call call;
  lmoc_rules rules;
  lmoc_steps steps;
  lmoc_step_hook hook;
  lmoc_radau radau;
  double *radau_memory;
  int method;                         /* `page_steps.c` */
  lmoc_finder finder;                 /* the functions whose signs end a piece: of laws first, then of events */
  int64_t law_roots;
  double *sides, *values, *now, *place;
  double instant, reached;            /* s, of what happens, and of the latest before */
  double *matrix;                     /* of least squares, (order, order), and what is solved with it */
  int64_t order;
  page_events events;
  page_jumps jumps;
  page_laws laws;
  page_coordinates coordinates;
};

/* Let the right-hand side be what is evaluated next. */
void lmoc_page_choose(lmoc_page *p);

/* Keep the last solution of nonlinear blocks, and go on from it. */
void lmoc_page_mark(lmoc_page *p);
void lmoc_page_go_back(lmoc_page *p);

int64_t lmoc_page_room_of_radau(lmoc_page *p);              /* doubles */
/* (n,) What the method has allowed itself in its last step; by how much rates differ from slopes of its way there, at most,
   where the answer is the state. */
void lmoc_page_allowed(const lmoc_page *p, double *errors);
void lmoc_page_defects(lmoc_page *p, double *defect);

/* Functions of laws from the state on, how many; their values, and those of events, for a state. */
int lmoc_page_watch_laws(lmoc_page *p, double time);
void lmoc_page_law_values(lmoc_page *p, double time, double *out);
void lmoc_page_edge_values(lmoc_page *p, double time, double *out);

/* What happens to discrete values where a piece has ended, and where laws have changed something: as of `happen.h`, from the
   answer on, which is the state then. The host is told of each thing. */
int lmoc_page_events_after(lmoc_page *p, double time, int crossed);
int lmoc_page_events_settle(lmoc_page *p, double time);

#if defined(__wasm__)
#define LMOC_HOST(name) __attribute__((import_module("host"), import_name(name)))
LMOC_HOST("laws") void lmoc_host_laws(void);          /* is told of what laws have done … */
LMOC_HOST("steps") void lmoc_host_steps(int found);   /* … the steps of inputs … */
LMOC_HOST("event") void lmoc_host_event(int found);   /* … and the discrete equations; and asked at the start: … */
LMOC_HOST("states") void lmoc_host_states(void);      /* … the answer is the state that discrete values lead to … */
LMOC_HOST("equations") void lmoc_host_equations(int first); /* … and they have the values of their equations there */
#else
static inline void lmoc_host_laws(void) {}
static inline void lmoc_host_steps(int found) { (void)found; }
static inline void lmoc_host_event(int found) { (void)found; }
static inline void lmoc_host_states(void) {}
static inline void lmoc_host_equations(int first) { (void)first; }
#endif

/* Steps. Both move the answer, and return 0, NO_VALUE of an instant, less than LMOC_STRUCK why laws leave no way, or else -1
   times a status of `jump.h`: of inputs that step now, and of what steps as discrete values have changed from those held. */
enum { LMOC_STRUCK = -100 };
int lmoc_page_steps_at(const lmoc_page *p, double time);    /* … whether inputs do */
int lmoc_page_discrete_steps(lmoc_page *p, double time);

/* What happens to laws as some functions vanish, or the states have jumped. */
int lmoc_page_laws_at(lmoc_page *p, double time, const uint8_t *roots, int jumped);

/* Read the events behind the programs (`page_events.c`). */
void lmoc_page_read_events(lmoc_page *p, lmoc_bytes *b);
void lmoc_page_read_laws(lmoc_page *p, lmoc_bytes *b);      /* … and the laws behind them (`page_laws.c`) */
void lmoc_page_read_coordinates(lmoc_page *p, lmoc_bytes *b); /* … and the choice of coordinates (`page_coordinates.c`) */
void lmoc_page_read_jumps(lmoc_page *p, lmoc_bytes *b);     /* … and what steps (`page_jumps.c`) */

#endif
