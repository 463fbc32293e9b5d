/* The functions of FMI 3.0 (fmi-standard.org), declared here by their names and types. */

#include "fmu.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } status;
typedef void (*log_message)(void *environment, status, const char *category, const char *text);

typedef struct {
  fmu *f;
  void *environment;
  log_message log;
} instance;

static void tell(void *own, const char *text) {
  instance *c = own;
  if (c->log) c->log(c->environment, ERROR, "logStatusError", text);
}

static status done(int found) { return found == FMU_GOOD ? OK : found == FMU_NO_VALUE ? DISCARD : ERROR; }

/* The call is allowed in some phases only. */
static int allowed(instance *c, int phases, const char *name) {
  if (!c) return 0;
  if (c->f->now.phase & phases) return 1;
  char text[120];
  snprintf(text, sizeof text, "%s is not allowed here", name);
  tell(c, text);
  return 0;
}

static status wrong(instance *c, const char *text) {
  if (c) tell(c, text);
  return ERROR;
}

#define ALLOW(phases, name) do { if (!allowed(c, phases, name)) return ERROR; } while (0)
#define RUNNING (FMU_INITIALIZING | FMU_EVENT | FMU_CONTINUOUS | FMU_STEPPING)
#define ANY (FMU_FRESH | FMU_CONFIGURING | RUNNING | FMU_ENDED | FMU_BROKEN)
#define READABLE (FMU_FRESH | RUNNING | FMU_ENDED | FMU_BROKEN)
#define WRITABLE (FMU_FRESH | RUNNING)

FMU_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

FMU_EXPORT status fmi3SetDebugLogging(instance *c, bool on, size_t n, const char *const categories[]) {
  (void)on, (void)n, (void)categories;
  return c ? OK : ERROR;
}

static instance *new_instance(const char *token, int co_simulation, void *environment, log_message log) {
  instance *c = calloc(1, sizeof *c);
  if (!c) return 0;
  c->environment = environment;
  c->log = log;
  if (!token || strcmp(token, lmoc_fmu_model.token)) tell(c, "the instantiation token is another one");
  else c->f = fmu_new(&lmoc_fmu_model, co_simulation, c, tell);
  if (c->f) return c;
  free(c);
  return 0;
}

FMU_EXPORT instance *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources,
                                                  bool visible, bool logging, void *environment, log_message log) {
  (void)name, (void)resources, (void)visible, (void)logging;
  return new_instance(token, 0, environment, log);
}

FMU_EXPORT instance *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                                 bool visible, bool logging, bool event_mode, bool early_return,
                                                 const uint32_t intermediate[], size_t n, void *environment,
                                                 log_message log, void *update) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return;
  (void)intermediate, (void)n, (void)update;
  return new_instance(token, 1, environment, log);
}

FMU_EXPORT instance *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                                       bool visible, bool logging, void *environment, log_message log,
                                                       void *clock, void *lock, void *unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
  if (log) log(environment, ERROR, "logStatusError", "there is no scheduled execution");
  return 0;
}

FMU_EXPORT void fmi3FreeInstance(instance *c) {
  if (!c) return;
  fmu_free(c->f);
  free(c);
}

/* ------------------------------------------------------------------ phases */

FMU_EXPORT status fmi3EnterInitializationMode(instance *c, bool has_tolerance, double tolerance, double start,
                                              bool has_stop, double stop) {
  (void)has_stop, (void)stop;
  ALLOW(FMU_FRESH, "fmi3EnterInitializationMode");
  if (!(start * 0 == 0)) return wrong(c, "the start time is no finite number");
  if (has_tolerance && tolerance > 0 && tolerance < 1) c->f->now.rtol = tolerance;
  fmu_set_time(c->f, start);
  c->f->now.begin = start;
  c->f->now.phase = FMU_INITIALIZING;
  return OK;
}

FMU_EXPORT status fmi3ExitInitializationMode(instance *c) {
  ALLOW(FMU_INITIALIZING, "fmi3ExitInitializationMode");
  const int found = fmu_accept(c->f);
  if (found) {
    c->f->now.phase = FMU_BROKEN;
    return ERROR;
  }
  c->f->now.phase = c->f->now.co_simulation ? FMU_STEPPING : FMU_EVENT;
  return OK;
}

FMU_EXPORT status fmi3EnterEventMode(instance *c) {
  ALLOW(FMU_CONTINUOUS, "fmi3EnterEventMode");
  c->f->now.phase = FMU_EVENT;
  return OK;
}

FMU_EXPORT status fmi3EnterContinuousTimeMode(instance *c) {
  ALLOW(FMU_EVENT, "fmi3EnterContinuousTimeMode");
  c->f->now.phase = FMU_CONTINUOUS;
  return OK;
}

FMU_EXPORT status fmi3EnterStepMode(instance *c) { return wrong(c, "there is no event mode in co-simulation"); }

FMU_EXPORT status fmi3EnterConfigurationMode(instance *c) {
  ALLOW(FMU_FRESH, "fmi3EnterConfigurationMode");
  c->f->now.phase = FMU_CONFIGURING;
  return OK;
}

FMU_EXPORT status fmi3ExitConfigurationMode(instance *c) {
  ALLOW(FMU_CONFIGURING, "fmi3ExitConfigurationMode");
  c->f->now.phase = FMU_FRESH;
  return OK;
}

FMU_EXPORT status fmi3Terminate(instance *c) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS | FMU_STEPPING | FMU_BROKEN, "fmi3Terminate");
  c->f->now.phase = FMU_ENDED;
  return OK;
}

FMU_EXPORT status fmi3Reset(instance *c) {
  ALLOW(ANY, "fmi3Reset");
  fmu_reset(c->f);
  return OK;
}

/* ------------------------------------------------------------------ values */

FMU_EXPORT status fmi3GetFloat64(instance *c, const uint32_t r[], size_t n, double values[], size_t count) {
  ALLOW(READABLE, "fmi3GetFloat64");
  if (n != count) return wrong(c, "there are as many values as variables");
  int found = FMU_GOOD;
  for (size_t i = 0; i < n; i++) {
    const int own = fmu_get(c->f, r[i], values + i);
    if (own > found) found = own;
  }
  return done(found);
}

FMU_EXPORT status fmi3SetFloat64(instance *c, const uint32_t r[], size_t n, const double values[], size_t count) {
  ALLOW(WRITABLE, "fmi3SetFloat64");
  if (n != count) return wrong(c, "there are as many values as variables");
  for (size_t i = 0; i < n; i++)
    if (fmu_set(c->f, r[i], values[i])) return ERROR;
  return OK;
}

/* All variables are Float64. */
#define NONE(name, type) \
  FMU_EXPORT status fmi3Get##name(instance *c, const uint32_t r[], size_t n, type values[], size_t count) { \
    (void)r, (void)values, (void)count; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  } \
  FMU_EXPORT status fmi3Set##name(instance *c, const uint32_t r[], size_t n, const type values[], size_t count) { \
    (void)r, (void)values, (void)count; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  }
typedef const char *text;
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, text)

FMU_EXPORT status fmi3GetBinary(instance *c, const uint32_t r[], size_t n, size_t sizes[], const uint8_t *values[],
                                size_t count) {
  (void)r, (void)sizes, (void)values, (void)count;
  return n ? wrong(c, "there are no variables of type Binary") : OK;
}

FMU_EXPORT status fmi3SetBinary(instance *c, const uint32_t r[], size_t n, const size_t sizes[],
                                const uint8_t *const values[], size_t count) {
  (void)r, (void)sizes, (void)values, (void)count;
  return n ? wrong(c, "there are no variables of type Binary") : OK;
}

/* There are no clocks, and no discrete states. */
#define NO_CLOCK(name, ...) \
  FMU_EXPORT status fmi3##name(instance *c, const uint32_t r[], size_t n, __VA_ARGS__) { \
    (void)r; \
    return n ? wrong(c, "there are no clocks") : OK; \
  }
NO_CLOCK(GetClock, bool *values)
NO_CLOCK(SetClock, const bool *values)
NO_CLOCK(GetIntervalDecimal, double *a, int *b)
NO_CLOCK(GetIntervalFraction, uint64_t *a, uint64_t *b, int *d)
NO_CLOCK(GetShiftDecimal, double *a)
NO_CLOCK(GetShiftFraction, uint64_t *a, uint64_t *b)
NO_CLOCK(SetIntervalDecimal, const double *a)
NO_CLOCK(SetIntervalFraction, const uint64_t *a, const uint64_t *b)
NO_CLOCK(SetShiftDecimal, const double *a)
NO_CLOCK(SetShiftFraction, const uint64_t *a, const uint64_t *b)

FMU_EXPORT status fmi3EvaluateDiscreteStates(instance *c) {
  ALLOW(FMU_INITIALIZING | FMU_EVENT, "fmi3EvaluateDiscreteStates");
  return OK;
}

FMU_EXPORT status fmi3ActivateModelPartition(instance *c, uint32_t clock, double time) {
  (void)clock, (void)time;
  return wrong(c, "there are no clocks");
}

FMU_EXPORT status fmi3GetNumberOfVariableDependencies(instance *c, uint32_t r, size_t *n) {
  (void)r, (void)n;
  return wrong(c, "dependencies do not change: they stand in the model description");
}

FMU_EXPORT status fmi3GetVariableDependencies(instance *c, uint32_t r, size_t elements[], uint32_t independents[],
                                              size_t of_independents[], int kinds[], size_t n) {
  (void)r, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)n;
  return wrong(c, "dependencies do not change: they stand in the model description");
}

/* ------------------------------------------------------------------ saved states */

typedef struct {
  size_t size;
  unsigned char bytes[];
} saved;

FMU_EXPORT status fmi3GetFMUState(instance *c, saved **state) {
  ALLOW(ANY, "fmi3GetFMUState");
  const size_t size = fmu_bytes(c->f);
  if (!*state) *state = malloc(sizeof(saved) + size);
  if (!*state) return wrong(c, "there is no memory");
  (*state)->size = size;
  fmu_save(c->f, (*state)->bytes);
  return OK;
}

FMU_EXPORT status fmi3SetFMUState(instance *c, saved *state) {
  ALLOW(ANY, "fmi3SetFMUState");
  return state ? done(fmu_restore(c->f, state->bytes, state->size)) : wrong(c, "there is no saved state");
}

FMU_EXPORT status fmi3FreeFMUState(instance *c, saved **state) {
  if (!c) return ERROR;
  if (state) {
    free(*state);
    *state = 0;
  }
  return OK;
}

FMU_EXPORT status fmi3SerializedFMUStateSize(instance *c, saved *state, size_t *size) {
  if (!c || !state) return wrong(c, "there is no saved state");
  *size = state->size;
  return OK;
}

FMU_EXPORT status fmi3SerializeFMUState(instance *c, saved *state, uint8_t bytes[], size_t size) {
  if (!c || !state || size < state->size) return wrong(c, "a saved state does not fit");
  memcpy(bytes, state->bytes, state->size);
  return OK;
}

FMU_EXPORT status fmi3DeserializeFMUState(instance *c, const uint8_t bytes[], size_t size, saved **state) {
  if (!c || size != fmu_bytes(c->f)) return wrong(c, "the saved state is one of another FMU");
  saved *made = realloc(*state, sizeof(saved) + size);
  if (!made) return wrong(c, "there is no memory");
  made->size = size;
  memcpy(made->bytes, bytes, size);
  *state = made;
  return OK;
}

/* ------------------------------------------------------------------ derivatives in a direction */

FMU_EXPORT status fmi3GetDirectionalDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                               const uint32_t knowns[], size_t columns, const double seed[],
                                               size_t seeds, double out[], size_t outs) {
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetDirectionalDerivative");
  if (seeds != columns || outs != rows) return wrong(c, "a seed for each known, a result for each unknown");
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 0));
}

FMU_EXPORT status fmi3GetAdjointDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                           const uint32_t knowns[], size_t columns, const double seed[], size_t seeds,
                                           double out[], size_t outs) {
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetAdjointDerivative");
  if (seeds != rows || outs != columns) return wrong(c, "a seed for each unknown, a result for each known");
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 1));
}

/* ------------------------------------------------------------------ model exchange */

FMU_EXPORT status fmi3UpdateDiscreteStates(instance *c, bool *again, bool *terminate, bool *nominals, bool *values,
                                           bool *has_next, double *next) {
  ALLOW(FMU_EVENT, "fmi3UpdateDiscreteStates");
  fmu_pass_breaks(c->f);
  *next = fmu_next_break(c->f);
  *has_next = *next < INFINITY;
  *again = *terminate = *nominals = *values = false;
  return OK;
}

FMU_EXPORT status fmi3CompletedIntegratorStep(instance *c, bool no_way_back, bool *enter, bool *terminate) {
  (void)no_way_back;
  ALLOW(FMU_CONTINUOUS, "fmi3CompletedIntegratorStep");
  *enter = *terminate = false;
  return done(fmu_accept(c->f));
}

FMU_EXPORT status fmi3SetTime(instance *c, double time) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS, "fmi3SetTime");
  if (c->f->now.co_simulation || !(time * 0 == 0)) return wrong(c, "this time cannot be set");
  fmu_set_time(c->f, time);
  return OK;
}

FMU_EXPORT status fmi3SetContinuousStates(instance *c, const double x[], size_t n) {
  ALLOW(FMU_CONTINUOUS, "fmi3SetContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  fmu_set_states(c->f, x);
  return OK;
}

FMU_EXPORT status fmi3GetContinuousStateDerivatives(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetContinuousStateDerivatives");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  return done(fmu_derivatives(c->f, out));
}

FMU_EXPORT status fmi3GetEventIndicators(instance *c, double out[], size_t n) {
  (void)out;
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetEventIndicators");
  return n ? wrong(c, "there are no event indicators") : OK;
}

FMU_EXPORT status fmi3GetContinuousStates(instance *c, double x[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  memcpy(x, c->f->x, n * sizeof(double));
  return OK;
}

FMU_EXPORT status fmi3GetNominalsOfContinuousStates(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi3GetNominalsOfContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  memcpy(out, c->f->model->nominal, n * sizeof(double));
  return OK;
}

FMU_EXPORT status fmi3GetNumberOfEventIndicators(instance *c, size_t *n) {
  if (!c) return ERROR;
  *n = 0;
  return OK;
}

FMU_EXPORT status fmi3GetNumberOfContinuousStates(instance *c, size_t *n) {
  if (!c) return ERROR;
  *n = (size_t)c->f->model->states;
  return OK;
}

/* ------------------------------------------------------------------ co-simulation */

FMU_EXPORT status fmi3GetOutputDerivatives(instance *c, const uint32_t r[], size_t n, const int32_t orders[],
                                           double values[], size_t count) {
  (void)r, (void)orders, (void)values, (void)count;
  return n ? wrong(c, "outputs have no derivatives here") : OK;
}

FMU_EXPORT status fmi3DoStep(instance *c, double time, double step, bool no_way_back, bool *event, bool *terminate,
                             bool *early, double *reached) {
  (void)no_way_back;
  ALLOW(FMU_STEPPING, "fmi3DoStep");
  fmu *f = c->f;
  *event = *terminate = *early = false;
  *reached = f->now.time;
  if (!(step > 0 && step * 0 == 0)) return wrong(c, "a step has a positive length");
  if (!(fabs(time - f->now.time) <= 1e-9 * (step + fabs(time)))) return wrong(c, "the last step has not led there");
  const int found = fmu_advance(f, time + step);
  *reached = f->now.time;
  if (!found) return OK;
  f->now.phase = FMU_BROKEN;
  return ERROR;
}
