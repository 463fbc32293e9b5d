/* An instance of a scene in an FMU: what FMI 2.0 and 3.0 have in common. The scene is data (`fmu_model`, written by
   `export/c_data.py`); programs are tapes that the engine interprets. */

#ifndef LMOC_FMU_H
#define LMOC_FMU_H

#include <stddef.h>

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
enum { FMU_PARAMETER, FMU_DERIVED, FMU_STATE, FMU_INPUT, FMU_DERIVATIVE, FMU_OBSERVED };

typedef struct {
  const char *token;
  int64_t registers, variables, states, inputs, parameters, given, kept, unknowns, breaks, outputs;
  int branches;                           /* blocks are closures of loops, which have several solutions */
  fmu_tape parametric, right, observe, slopes;
  const int32_t *kind, *place;            /* (variables,); place: which parameter, state, input; or a register */
  const int32_t *state, *derivative;      /* (states,) registers */
  const int32_t *input;                   /* (inputs,) registers */
  const int32_t *parameter;               /* (parameters,) places on the tape of parameters */
  const int32_t *given_registers;         /* (given,) registers that follow from parameters */
  const int32_t *kept_registers;          /* (kept,) registers that observed variables are computed from */
  const int32_t *unknown;                 /* (unknowns,) registers of unknowns of nonlinear blocks … */
  const double *guess;                    /* … where the scene starts */
  const double *known;                    /* (registers of the parametric tape) values that nothing changes */
  const double *start, *nominal;          /* (states,) */
  const double *input_start, *parameter_start;
  const double *break_times;              /* s, where functions of time have kinks or jumps */
  const int32_t *rows, *columns;          /* (slopes.result_count,) derivatives first, then outputs; states, then inputs */
  const int32_t *output;                  /* (outputs,) registers of the rows behind the derivatives */
  const double *weights, *nodes, *dense, *omitted;
  lmoc_rules rules;
  double start_time, tolerance;
} fmu_model;

extern const fmu_model lmoc_fmu_model;

/* What calls are allowed in. */
enum {
  FMU_FRESH = 1, FMU_INITIALIZING = 2, FMU_EVENT = 4, FMU_CONTINUOUS = 8, FMU_STEPPING = 16, FMU_ENDED = 32,
  FMU_BROKEN = 64, FMU_CONFIGURING = 128
};

/* What a step or a value has come to. */
enum { FMU_GOOD, FMU_NO_VALUE, FMU_WRONG };

/* What a function of FMI returns; the last only in 2.0. */
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;

typedef void (*fmu_tell)(void *own, const char *text);

typedef struct {
  double time, begin, wish, rtol, call_time, marked_time;
  int64_t solved, marked, first_break;
  int32_t phase, co_simulation, stale, evaluated, observed, judged;
} fmu_scalars;

typedef struct fmu {
  fmu_scalars now;
  const fmu_model *model;
  lmoc_tape tape[4];
  lmoc_block *blocks[4];
  double *memory, *p, *x, *u, *w[4], *solution, *solution_x, *sign, *work;  /* one piece of memory, then scratch */
  int64_t doubles, pivot_count;
  int32_t *pivots;
  const lmoc_call *last;
  lmoc_call call;
  void *owner;
  fmu_tell tell;
} fmu;

fmu *fmu_new(const fmu_model *model, int co_simulation, void *owner, fmu_tell tell);
void fmu_free(fmu *f);
void fmu_reset(fmu *f);

int fmu_get(fmu *f, uint32_t reference, double *value);
int fmu_set(fmu *f, uint32_t reference, double value);
int fmu_state_of(const fmu *f, uint32_t reference);  /* which state; -1: none */

int fmu_derivatives(fmu *f, double *out);
void fmu_set_time(fmu *f, double time);
void fmu_set_states(fmu *f, const double *x);

/* At the start of simulation, and whenever the other side says that a step is accepted. */
int fmu_accept(fmu *f);
double fmu_next_break(const fmu *f);  /* s, infinity where there is none */
void fmu_pass_breaks(fmu *f);

/* Integrate to a time; `f->now.time` is where it has come to. */
int fmu_advance(fmu *f, double end);

int fmu_directional(fmu *f, const uint32_t *unknowns, size_t rows, const uint32_t *knowns, size_t columns,
                    const double *seed, double *out, int adjoint);

/* All that changes, as bytes. */
size_t fmu_bytes(const fmu *f);
void fmu_save(fmu *f, unsigned char *to);
int fmu_restore(fmu *f, const unsigned char *from, size_t size);

#endif
