/* An instance of a scene in an FMU: what FMI 2.0 and 3.0 have in common. The scene is data (`fmu_model`, written by
   `export/c_data.py`); programs are tapes that the engine interprets. */

#ifndef LMOC_FMU_H
#define LMOC_FMU_H

#include <stddef.h>

#include "beside.h"
#include "free_dynamics.h"
#include "happen.h"
#include "jump.h"
#include "landing.h"
#include "law_run.h"
#include "roots.h"
#include "walk.h"

#if defined(_WIN32)
#define FMU_EXPORT __declspec(dllexport)
#else
#define FMU_EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
  int64_t size, time, block_count, constant_count, result_count;
  const int32_t *places;      /* of constants … */
  const double *values;       /* … and their values */
  const int32_t *code, *index;
  const lmoc_block *blocks;   /* as they begin; pivots and factors belong to an instance */
  const int64_t *pivots;      /* (blocks,) how many */
  const int32_t *results;
} fmu_tape;

/* What a value reference stands for. 0 is time, k is row k - 1 of the table. */
enum {
  FMU_PARAMETER, FMU_DERIVED, FMU_STATE, FMU_INPUT, FMU_DERIVATIVE, FMU_OBSERVED, FMU_DISCRETE, FMU_INDICATOR
};
enum { FMU_REAL, FMU_INTEGER, FMU_BOOLEAN };

/* The events of a scene, as `export/instants.py` describes them: tables of registers. */
typedef struct {
  lmoc_instant tables;                    /* places are registers of `assign` */
  int64_t checks, watched, branches, seen, parameters, begun, kept, absent, initial, terminal;
  fmu_tape look, assign, line, begin;
  const int32_t *registers, *zero;        /* (discrete,), (zeros,) of `look` */
  const int32_t *reinit_register, *check_error, *held, *held_error, *first_known, *known, *branch, *seen_registers,
                *parameter_registers, *begun_ones, *kept_registers;
  const double *start;
  const char *const *texts, *const *told_texts, *const *held_texts;
  double longest;                         /* s, of a step */
} fmu_events;

/* Closed loops whose coordinates are all states, as `export/loops.py` describes them; none where `stages` is 0. */
typedef struct {
  int64_t residuals, entries, groups;
  const lmoc_loops *group;                /* their tables; room belongs to an instance */
  fmu_tape tape;                          /* results: entries, then residuals */
} fmu_closures;

typedef struct {
  int64_t stages, given;
  fmu_closures stage[2];
  const int32_t *given_registers;         /* that closures read and parameters fill */
  const double *scale, *held;             /* (states,) sizes; the same, 0 for states that are given at the start */
  const lmoc_flag *closing;               /* (parameters,) whether closures depend on one */
} fmu_loops;

/* The laws of a scene, as `export/laws.py` describes them: an entry for each law. Registers are those of `right` where
   nothing else is said. */
typedef struct {
  lmoc_laws laws;
  const lmoc_flag *unilateral, *curved, *linear, *position, *ledger;  /* (`law_run.h`) */
  fmu_tape by_force, by_state;            /* the quantities with their derivatives (`free_dynamics.h`) … */
  int64_t given;
  const int32_t *given_registers;         /* … from these registers, which parameters, inputs and events fill */
  const int32_t *force_entry, *state_entry, *quantity;
  const int32_t *known, *restitution;     /* (6, n), (n,) places on the tape of parameters; -1 for none */
  const int32_t *inputs, *held;           /* (3, n), (states,) registers of a mode; -1 for none */
  const int32_t *read;                    /* (4, n) registers of `look` */
  const double *noise;                    /* what levels are by rounding alone */
  const char *const *names, *const *closings, *const *openings;
} fmu_laws;

/* The values that may step while the equations hold derivatives of them, as `export/jumps.py` describes them. */
typedef struct {
  int64_t count, given, rows, judged, kept, early;
  fmu_tape rates;
  const int32_t *registers;               /* (count,) of `look` */
  const int32_t *lower, *upper, *origin, *second, *ledger;  /* (`jump.h`) */
  const int32_t *which, *own, *results;   /* (given,), (given,), (states + judged,) of `rates` */
  const int32_t *from, *to;               /* (kept,) registers of `right`, and of `rates`, which begins with their values */
  const int32_t *early_ones;              /* (early,) relations that are at the start what they were right before */
  const char *const *names;               /* (count,) */
} fmu_jumps;

typedef struct {
  const char *token;
  int64_t registers, variables, states, inputs, parameters, given, kept, unknowns, breaks, outputs, assumed;
  int branches;                           /* blocks are closures of loops, which have several solutions */
  fmu_tape parametric, right, observe, slopes;
  const int32_t *kind, *place, *type;     /* (variables,); place: which parameter, state, input; or a register */
  const int32_t *state, *derivative;      /* (states,) registers */
  const int32_t *input;                   /* (inputs,) registers */
  const int32_t *parameter;               /* (parameters,) places on the tape of parameters */
  const int32_t *given_registers;         /* (given,) registers that follow from parameters */
  const int32_t *kept_registers;          /* (kept,) registers that observed variables are computed from */
  const int32_t *unknown;                 /* (unknowns,) registers of unknowns of nonlinear blocks … */
  const double *guess;                    /* … where the scene starts */
  const lmoc_flag *turning;               /* (unknowns,) what is no length: an angle may be whole turns away */
  int64_t tied;                           /* variables of closed loops that are not given at the start … */
  const int32_t *tied_registers;          /* … of `observe` */
  const double *tied_values, *reach;      /* … in the scene, and how far from there a start is told of */
  const double *known;                    /* (registers of the parametric tape) values that nothing changes */
  const double *start, *nominal;          /* (states,) */
  const double *input_start, *parameter_start;
  const double *break_times;              /* s, where functions of time have kinks or jumps */
  const int32_t *rows, *columns;          /* (slopes.result_count,) derivatives first, then outputs; states, then inputs */
  const int32_t *output;                  /* (outputs,) registers of the rows behind the derivatives */
  const int32_t *assumption, *assumption_error; /* (assumed,) places on the tape of parameters: what they have to fulfil */
  const char *const *assumption_texts;
  const double *weights, *nodes, *dense, *omitted;
  lmoc_rules rules;
  fmu_events events;
  fmu_laws laws;
  fmu_jumps jumps;
  fmu_loops loops;
  double start_time, span, tolerance;     /* s, of the experiment */
  double finer, no_finer;                 /* factor on the tolerance of steps, and its least result */
} fmu_model;

extern const fmu_model lmoc_fmu_model;

/* What calls are allowed in. */
enum {
  FMU_FRESH = 1, FMU_INITIALIZING = 2, FMU_EVENT = 4, FMU_CONTINUOUS = 8, FMU_STEPPING = 16, FMU_ENDED = 32,
  FMU_BROKEN = 64, FMU_CONFIGURING = 128
};

/* What a step or a value has come to. */
enum { FMU_GOOD, FMU_NO_VALUE, FMU_WRONG };

/* The tapes of an instance. */
enum {
  PARAMETRIC, RIGHT, OBSERVE, SLOPES, LOOK, ASSIGN, LINES, BEGIN, BY_FORCE, BY_STATE, JUMP, POSITIONS, VELOCITIES, TAPES
};

/* What a function of FMI returns; the last only in 2.0. */
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;

typedef void (*fmu_tell)(void *own, const char *text);

typedef struct {
  double time, begin, wish, rtol, call_time, marked_time;
  double next, last_instant, turned;      /* s: the next time event, the last one, the last that changed the motion */
  double loop_time;                       /* s, of `loop_x` */
  int64_t solved, marked, first_break;
  int32_t phase, co_simulation, stale, evaluated, observed, judged;
  int32_t fits;                           /* the parameters fulfil what is assumed of them */
  int32_t stands;                         /* of a saved state: what stands in the registers is the last solution */
  int32_t settled, begun, ended;          /* discrete values agree; those of the start are past; the model has ended */
  int32_t jumped, closed;                 /* states at the last event; the closures of loops have been found … */
  int32_t compared;                       /* … and compared with those of the scene */
  int32_t parted;                         /* parameters have been set that move what laws keep closed */
  int32_t anew;                           /* the motion goes on by other equations or from other states since then */
  int32_t drifted;                        /* the states have left the closures of loops by more than the tolerance */
  double foreseen;                        /* s, of the event that ends low hops; infinity: none is foreseen */
  int32_t surprised;                      /* the last one could not be foreseen, or has been prevented */
} fmu_scalars;

typedef struct fmu {
  fmu_scalars now;
  lmoc_instant e;
  lmoc_finder finder;
  lmoc_hops hops;
  lmoc_events events;
  lmoc_law_run laws;
  lmoc_free_dynamics scene;
  lmoc_closures closures;
  lmoc_closure_stage stage[2];
  const fmu_model *model;
  lmoc_tape tape[TAPES];
  lmoc_block *blocks[TAPES];
  /* one piece of memory, then scratch */
  double *memory, *p, *x, *u, *w[TAPES], *solution, *solution_x, *sign;
  double *branch;                               /* (3 unknowns,) of a step (`fmu_branches.c`) */
  double *warned;                               /* (watched,) whether it has been said that one does not hold */
  double *known, *restitution, *unresolved;     /* of the laws */
  double *errors;                               /* (states,) what the integrator allows itself in a step */
  double *loop_x;                               /* states at the last look at loops; and room */
  double *loop_moved, *loop_wanted, *loop_before, *loop_sizes, *loop_p;
  double *law_read, *law_before, *law_moved;
  double *step, *at_event;                      /* values on both sides (`jumps.c`), and discrete ones */
  lmoc_flag *law_which;                         /* (2 n,) */
  int64_t patience;                             /* steps in which something has to happen */
  double *foresight, *ahead;                    /* of `fmu_hops.c`; scratch for the same */
  double *work, *noise, *moved, *root, *which, *before;
  int64_t doubles, pivot_count, orders;
  double *order;                                /* (orders,) of sparse factors, on their way to or from a saved state */
  int32_t *pivots;
  const lmoc_call *last;
  lmoc_call call;
  int failed, located;                          /* what has held up the laws; whether `finder.which` tells of a root
                                                   where the time stands */
  void *owner;
  fmu_tell tell, warn, note;
} fmu;

fmu *fmu_new(const fmu_model *model, int co_simulation, void *owner, fmu_tell tell, fmu_tell warn, fmu_tell note);
void fmu_free(fmu *f);
void fmu_reset(fmu *f);

int fmu_get(fmu *f, uint32_t reference, double *value);
int fmu_set(fmu *f, uint32_t reference, double value);

int fmu_derivatives(fmu *f, double *out);
int fmu_states(fmu *f, double *out);
void fmu_set_time(fmu *f, double time);
void fmu_set_states(fmu *f, const double *x);

/* Steps (`fmu_steps.c`): at the start of simulation, and whenever the other side says that a step is accepted. */
int fmu_accept(fmu *f);

/* Whether closures of loops stand as they did, and have come along a step that is to be judged on their branch. */
int fmu_branches_stand(fmu *f);
int fmu_branches_follow(fmu *f, const lmoc_steps *s);

/* Integrate to a time; `f->now.time` is where it has come to. */
int fmu_advance(fmu *f, double end);
int fmu_smooth(fmu *f, double end, int *root);          /* as long as nothing happens; `root`: something does at its end */

int fmu_directional(fmu *f, const uint32_t *unknowns, size_t rows, const uint32_t *knowns, size_t columns,
                    const double *seed, double *out, int adjoint);

/* What has been solved (`fmu_instances.c`). */
void fmu_forget(fmu *f);                                /* no factors are kept: the equations are others */
void fmu_guess(fmu *f);                                 /* nonlinear blocks begin as the scene is at its start */

/* How it stands within the equations (`fmu.c`). */
int fmu_lost(fmu *f);                                   /* a nonlinear block has no solution there */
int fmu_solve(fmu *f, double time, const double *x);    /* those of the derivatives … */
int fmu_look(fmu *f, double time, const double *x);     /* … and registers of LOOK at a place */
void fmu_settle(fmu *f);                                /* parameters, inputs and modes into the registers */
int fmu_evaluate(fmu *f);                               /* the derivatives, where they are not known yet */
int fmu_fits(fmu *f);                                   /* the same, and FMU_WRONG where parameters must not be so */
void fmu_changed(fmu *f);
int fmu_refused(fmu *f, const char *text);

/* Events (`events.c`). */
int64_t fmu_roots(const fmu *f);                        /* how many functions change sign where something happens … */
int fmu_indicators(fmu *f, double time, const double *x, double *out);
void fmu_sides(const fmu *f, double *out);              /* … their signs, 0 where it is that of their value … */
void fmu_seen(fmu *f);                                  /* … at a place that has been looked at … */
void fmu_followed(fmu *f);                              /* … and along a whole step */
void fmu_allow(fmu *f);                                 /* `errors`, as the states are now */
int fmu_begin(fmu *f, int for_good);                    /* the discrete values at the start */
int fmu_happen(fmu *f);                                 /* all that happens at an instant; `f->x` may jump */
int fmu_asks(fmu *f, const double *values);             /* whether anything has to happen with such values … */
int fmu_passed(fmu *f);                                 /* … as they are now: the other side has missed it */
int fmu_holds(fmu *f);                                  /* FMU_WRONG where an assertion about the motion does not hold */
double fmu_next(const fmu *f);                          /* s, of the next time event or break … */
double fmu_next_break(const fmu *f);                    /* … and of the next break */

/* Events of Model Exchange, and low hops between them (`fmu_hops.c`). */
int64_t fmu_hop_room(const fmu_model *m, int64_t roots);
int fmu_event(fmu *f);                                  /* `fmu_happen`, and what is foreseen */
void fmu_surprise(fmu *f);                              /* something from outside prevents what has been foreseen */
void fmu_hop_indicators(const fmu *f, double *laws);    /* gaps of low hops are not watched closer than they are known */

/* What steps that the equations hold derivatives of (`jumps.c`): the states may jump. */
int64_t fmu_jump_room(const fmu_model *m);
int fmu_input_steps(fmu *f);                            /* at the breaks that the time has come to, which are past then */
int fmu_discrete_steps(fmu *f, const double *before);   /* with the discrete values before an event, and now */

/* When one of them first leaves its side within the last step (`events.c`): s, infinity where none does. */
int fmu_first_root(fmu *f, double begin, double end, int (*states)(void *own, double time, double *x), void *own,
                   double *time);

/* All that changes, as bytes. */
size_t fmu_bytes(const fmu *f);
void fmu_save(fmu *f, unsigned char *to);
int fmu_restore(fmu *f, const unsigned char *from, size_t size);

#endif
