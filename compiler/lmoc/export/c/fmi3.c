/* The functions of FMI 3.0 (fmi-standard.org), declared here by their names and types. */

#include "fmu.h"

#include <stdbool.h>

typedef void (*log_message)(void *environment, status, const char *category, const char *text);

typedef struct {
  fmu *f;
  void *environment;
  log_message log;
  int logging;
} instance;

static void tell(void *own, const char *text) {
  instance *c = own;
  if (c->log) c->log(c->environment, ERROR, "logStatusError", text);
}

static void warn(void *own, const char *text) {
  instance *c = own;
  if (c->log) c->log(c->environment, WARNING, "logStatusWarning", text);
}

static void note(void *own, const char *text) {
  instance *c = own;
  if (c->log && c->logging) c->log(c->environment, OK, "logEvents", text);
}

#define FMI(name) fmi3##name
typedef bool boolean;
#include "fmi.h"

FMU_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

static instance *new_instance(const char *token, int co_simulation, int logging, void *environment, log_message log) {
  instance *c = calloc(1, sizeof *c);
  if (!c) return 0;
  c->environment = environment;
  c->log = log;
  c->logging = logging;
  return filled(c, token, co_simulation);
}

FMU_EXPORT instance *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources,
                                                  bool visible, bool logging, void *environment, log_message log) {
  (void)name, (void)resources, (void)visible;
  return new_instance(token, 0, logging, environment, log);
}

FMU_EXPORT instance *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                                 bool visible, bool logging, bool event_mode, bool early_return,
                                                 const uint32_t intermediate[], size_t n, void *environment,
                                                 log_message log, void *update) {
  (void)name, (void)resources, (void)visible, (void)event_mode, (void)early_return;
  (void)intermediate, (void)n, (void)update;
  return new_instance(token, 1, logging, environment, log);
}

FMU_EXPORT instance *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                                       bool visible, bool logging, void *environment, log_message log,
                                                       void *clock, void *lock, void *unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
  if (log) log(environment, ERROR, "logStatusError", "there is no scheduled execution");
  return 0;
}

/* ------------------------------------------------------------------ phases */

FMU_EXPORT status fmi3EnterInitializationMode(instance *c, bool has_tolerance, double tolerance, double start,
                                              bool has_stop, double stop) {
  (void)has_stop, (void)stop;
  ALLOW(FMU_FRESH);
  const status found = set_up(c, has_tolerance, tolerance, start);
  if (!found) c->f->now.phase = FMU_INITIALIZING;
  return found;
}

FMU_EXPORT status fmi3EnterStepMode(instance *c) { return wrong(c, "there is no event mode in co-simulation"); }

FMU_EXPORT status fmi3EnterConfigurationMode(instance *c) {
  ALLOW(FMU_FRESH);
  c->f->now.phase = FMU_CONFIGURING;
  return OK;
}

FMU_EXPORT status fmi3ExitConfigurationMode(instance *c) {
  ALLOW(FMU_CONFIGURING);
  c->f->now.phase = FMU_FRESH;
  return OK;
}

/* ------------------------------------------------------------------ values */

FMU_EXPORT status fmi3GetFloat64(instance *c, const uint32_t r[], size_t n, double values[], size_t count) {
  ALLOW(READABLE);
  if (n != count) return wrong(c, "there are as many values as variables");
  return get_values(c, r, n, values);
}

FMU_EXPORT status fmi3SetFloat64(instance *c, const uint32_t r[], size_t n, const double values[], size_t count) {
  ALLOW(WRITABLE);
  if (n != count) return wrong(c, "there are as many values as variables");
  return set_values(c, r, n, values);
}

#define COUNT , size_t count
NONE(Float32, float, COUNT)
NONE(Int8, int8_t, COUNT)
NONE(UInt8, uint8_t, COUNT)
NONE(Int16, int16_t, COUNT)
NONE(UInt16, uint16_t, COUNT)
READ_ONLY(Int32, int32_t, FMU_INTEGER, COUNT)
NONE(UInt32, uint32_t, COUNT)
NONE(Int64, int64_t, COUNT)
NONE(UInt64, uint64_t, COUNT)
READ_ONLY(Boolean, bool, FMU_BOOLEAN, COUNT)
NONE(String, text, COUNT)

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
  ALLOW(FMU_INITIALIZING | FMU_EVENT);
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

/* ------------------------------------------------------------------ derivatives in a direction */

FMU_EXPORT status fmi3GetDirectionalDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                               const uint32_t knowns[], size_t columns, const double seed[],
                                               size_t seeds, double out[], size_t outs) {
  ALLOW(RUNNING | FMU_ENDED);
  if (seeds != columns || outs != rows) return wrong(c, "a seed for each known, a result for each unknown");
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 0));
}

FMU_EXPORT status fmi3GetAdjointDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                           const uint32_t knowns[], size_t columns, const double seed[], size_t seeds,
                                           double out[], size_t outs) {
  ALLOW(RUNNING | FMU_ENDED);
  if (seeds != rows || outs != columns) return wrong(c, "a seed for each unknown, a result for each known");
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 1));
}

/* ------------------------------------------------------------------ model exchange */

FMU_EXPORT status fmi3UpdateDiscreteStates(instance *c, bool *again, bool *terminate, bool *nominals, bool *values,
                                           bool *has_next, double *next) {
  ALLOW(FMU_EVENT);
  const status found = updated(c, next);
  *has_next = *next < INFINITY;
  *again = *nominals = false;
  *terminate = c->f->now.ended;
  *values = c->f->now.anew;
  return found;
}

FMU_EXPORT status fmi3GetNumberOfEventIndicators(instance *c, size_t *n) {
  if (!c) return ERROR;
  *n = (size_t)fmu_roots(c->f);
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
  ALLOW(FMU_STEPPING);
  *event = *terminate = *early = false;
  const status found = step_from(c, time, step);
  *terminate = c->f->now.ended;
  *reached = c->f->now.time;
  return found;
}
