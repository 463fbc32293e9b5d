/* The functions of FMI 2.0 (fmi-standard.org), declared here by their names and types. */

#include "fmu.h"

#include <stdio.h>
#include <stdlib.h>

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;

typedef struct {
  void (*log)(void *environment, const char *name, status, const char *category, const char *text, ...);
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*finished)(void *environment, status);
  void *environment;
} callbacks;

typedef struct {
  int again, terminate, nominals_changed, values_changed, has_next;
  double next;
} event_info;

typedef struct {
  fmu *f;
  callbacks calls;
  char name[200];
} instance;

static void tell(void *own, const char *text) {
  instance *c = own;
  if (c->calls.log) c->calls.log(c->calls.environment, c->name, ERROR, "logStatusError", "%s", text);
}

static status done(int found) { return found == FMU_GOOD ? OK : found == FMU_NO_VALUE ? DISCARD : ERROR; }

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
#define READABLE (FMU_FRESH | RUNNING | FMU_ENDED | FMU_BROKEN)
#define WRITABLE (FMU_FRESH | RUNNING)

FMU_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMU_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

FMU_EXPORT status fmi2SetDebugLogging(instance *c, int on, size_t n, const char *const categories[]) {
  (void)on, (void)n, (void)categories;
  return c ? OK : ERROR;
}

FMU_EXPORT instance *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                                     const callbacks *calls, int visible, int logging) {
  (void)resources, (void)visible, (void)logging;
  instance *c = calloc(1, sizeof *c);
  if (!c) return 0;
  if (calls) c->calls = *calls;
  snprintf(c->name, sizeof c->name, "%s", name ? name : "");
  if (!token || strcmp(token, lmoc_fmu_model.token)) tell(c, "the GUID is another one");
  else c->f = fmu_new(&lmoc_fmu_model, type == 1, c, tell);
  if (c->f) return c;
  free(c);
  return 0;
}

FMU_EXPORT void fmi2FreeInstance(instance *c) {
  if (!c) return;
  fmu_free(c->f);
  free(c);
}

/* ------------------------------------------------------------------ phases */

FMU_EXPORT status fmi2SetupExperiment(instance *c, int has_tolerance, double tolerance, double start, int has_stop,
                                      double stop) {
  (void)has_stop, (void)stop;
  ALLOW(FMU_FRESH, "fmi2SetupExperiment");
  if (!(start * 0 == 0)) return wrong(c, "the start time is no finite number");
  if (has_tolerance && tolerance > 0 && tolerance < 1) c->f->now.rtol = tolerance;
  fmu_set_time(c->f, start);
  c->f->now.begin = start;
  return OK;
}

FMU_EXPORT status fmi2EnterInitializationMode(instance *c) {
  ALLOW(FMU_FRESH, "fmi2EnterInitializationMode");
  c->f->now.phase = FMU_INITIALIZING;
  return OK;
}

FMU_EXPORT status fmi2ExitInitializationMode(instance *c) {
  ALLOW(FMU_INITIALIZING, "fmi2ExitInitializationMode");
  const int found = fmu_accept(c->f);
  if (found) {
    c->f->now.phase = FMU_BROKEN;
    return ERROR;
  }
  c->f->now.phase = c->f->now.co_simulation ? FMU_STEPPING : FMU_EVENT;
  return OK;
}

FMU_EXPORT status fmi2EnterEventMode(instance *c) {
  ALLOW(FMU_CONTINUOUS, "fmi2EnterEventMode");
  c->f->now.phase = FMU_EVENT;
  return OK;
}

FMU_EXPORT status fmi2EnterContinuousTimeMode(instance *c) {
  ALLOW(FMU_EVENT, "fmi2EnterContinuousTimeMode");
  c->f->now.phase = FMU_CONTINUOUS;
  return OK;
}

FMU_EXPORT status fmi2Terminate(instance *c) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS | FMU_STEPPING | FMU_BROKEN, "fmi2Terminate");
  c->f->now.phase = FMU_ENDED;
  return OK;
}

FMU_EXPORT status fmi2Reset(instance *c) {
  ALLOW(READABLE, "fmi2Reset");
  fmu_reset(c->f);
  return OK;
}

/* ------------------------------------------------------------------ values */

FMU_EXPORT status fmi2GetReal(instance *c, const uint32_t r[], size_t n, double values[]) {
  ALLOW(READABLE, "fmi2GetReal");
  int found = FMU_GOOD;
  for (size_t i = 0; i < n; i++) {
    const int own = fmu_get(c->f, r[i], values + i);
    if (own > found) found = own;
  }
  return done(found);
}

FMU_EXPORT status fmi2SetReal(instance *c, const uint32_t r[], size_t n, const double values[]) {
  ALLOW(WRITABLE, "fmi2SetReal");
  for (size_t i = 0; i < n; i++)
    if (fmu_set(c->f, r[i], values[i])) return ERROR;
  return OK;
}

/* All variables are real. */
#define NONE(name, type) \
  FMU_EXPORT status fmi2Get##name(instance *c, const uint32_t r[], size_t n, type values[]) { \
    (void)r, (void)values; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  } \
  FMU_EXPORT status fmi2Set##name(instance *c, const uint32_t r[], size_t n, const type values[]) { \
    (void)r, (void)values; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  }
typedef const char *text;
NONE(Integer, int)
NONE(Boolean, int)
NONE(String, text)

/* ------------------------------------------------------------------ saved states */

typedef struct {
  size_t size;
  unsigned char bytes[];
} saved;

FMU_EXPORT status fmi2GetFMUstate(instance *c, saved **state) {
  ALLOW(READABLE, "fmi2GetFMUstate");
  const size_t size = fmu_bytes(c->f);
  if (!*state) *state = malloc(sizeof(saved) + size);
  if (!*state) return wrong(c, "there is no memory");
  (*state)->size = size;
  fmu_save(c->f, (*state)->bytes);
  return OK;
}

FMU_EXPORT status fmi2SetFMUstate(instance *c, saved *state) {
  ALLOW(READABLE, "fmi2SetFMUstate");
  return state ? done(fmu_restore(c->f, state->bytes, state->size)) : wrong(c, "there is no saved state");
}

FMU_EXPORT status fmi2FreeFMUstate(instance *c, saved **state) {
  if (!c) return ERROR;
  if (state) {
    free(*state);
    *state = 0;
  }
  return OK;
}

FMU_EXPORT status fmi2SerializedFMUstateSize(instance *c, saved *state, size_t *size) {
  if (!c || !state) return wrong(c, "there is no saved state");
  *size = state->size;
  return OK;
}

FMU_EXPORT status fmi2SerializeFMUstate(instance *c, saved *state, char bytes[], size_t size) {
  if (!c || !state || size < state->size) return wrong(c, "a saved state does not fit");
  memcpy(bytes, state->bytes, state->size);
  return OK;
}

FMU_EXPORT status fmi2DeSerializeFMUstate(instance *c, const char bytes[], size_t size, saved **state) {
  if (!c || size != fmu_bytes(c->f)) return wrong(c, "the saved state is one of another FMU");
  saved *made = realloc(*state, sizeof(saved) + size);
  if (!made) return wrong(c, "there is no memory");
  made->size = size;
  memcpy(made->bytes, bytes, size);
  *state = made;
  return OK;
}

FMU_EXPORT status fmi2GetDirectionalDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                               const uint32_t knowns[], size_t columns, const double seed[],
                                               double out[]) {
  ALLOW(RUNNING | FMU_ENDED, "fmi2GetDirectionalDerivative");
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 0));
}

/* ------------------------------------------------------------------ model exchange */

FMU_EXPORT status fmi2NewDiscreteStates(instance *c, event_info *info) {
  ALLOW(FMU_EVENT, "fmi2NewDiscreteStates");
  fmu_pass_breaks(c->f);
  const double next = fmu_next_break(c->f);
  *info = (event_info){.has_next = next < INFINITY, .next = next};
  return OK;
}

FMU_EXPORT status fmi2CompletedIntegratorStep(instance *c, int no_way_back, int *enter, int *terminate) {
  (void)no_way_back;
  ALLOW(FMU_CONTINUOUS, "fmi2CompletedIntegratorStep");
  *enter = *terminate = 0;
  return done(fmu_accept(c->f));
}

FMU_EXPORT status fmi2SetTime(instance *c, double time) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS, "fmi2SetTime");
  if (!(time * 0 == 0)) return wrong(c, "the time is no finite number");
  fmu_set_time(c->f, time);
  return OK;
}

FMU_EXPORT status fmi2SetContinuousStates(instance *c, const double x[], size_t n) {
  ALLOW(FMU_CONTINUOUS, "fmi2SetContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  fmu_set_states(c->f, x);
  return OK;
}

FMU_EXPORT status fmi2GetDerivatives(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi2GetDerivatives");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  return done(fmu_derivatives(c->f, out));
}

FMU_EXPORT status fmi2GetEventIndicators(instance *c, double out[], size_t n) {
  (void)out;
  ALLOW(RUNNING | FMU_ENDED, "fmi2GetEventIndicators");
  return n ? wrong(c, "there are no event indicators") : OK;
}

FMU_EXPORT status fmi2GetContinuousStates(instance *c, double x[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi2GetContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  memcpy(x, c->f->x, n * sizeof(double));
  return OK;
}

FMU_EXPORT status fmi2GetNominalsOfContinuousStates(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED, "fmi2GetNominalsOfContinuousStates");
  if ((int64_t)n != c->f->model->states) return wrong(c, "there are not as many states");
  memcpy(out, c->f->model->nominal, n * sizeof(double));
  return OK;
}

/* ------------------------------------------------------------------ co-simulation */

FMU_EXPORT status fmi2SetRealInputDerivatives(instance *c, const uint32_t r[], size_t n, const int orders[],
                                              const double values[]) {
  (void)r, (void)orders, (void)values;
  return n ? wrong(c, "inputs are not interpolated") : OK;
}

FMU_EXPORT status fmi2GetRealOutputDerivatives(instance *c, const uint32_t r[], size_t n, const int orders[],
                                               double values[]) {
  (void)r, (void)orders, (void)values;
  return n ? wrong(c, "outputs have no derivatives here") : OK;
}

FMU_EXPORT status fmi2DoStep(instance *c, double time, double step, int no_way_back) {
  (void)no_way_back;
  ALLOW(FMU_STEPPING, "fmi2DoStep");
  fmu *f = c->f;
  if (!(step > 0 && step * 0 == 0)) return wrong(c, "a step has a positive length");
  if (!(fabs(time - f->now.time) <= 1e-9 * (step + fabs(time)))) return wrong(c, "the last step has not led there");
  if (!fmu_advance(f, time + step)) return OK;
  f->now.phase = FMU_BROKEN;
  return ERROR;
}

FMU_EXPORT status fmi2CancelStep(instance *c) { return wrong(c, "steps are not asynchronous"); }

FMU_EXPORT status fmi2GetStatus(instance *c, int kind, status *value) {
  (void)kind, (void)value;
  if (!c) return ERROR;
  tell(c, "steps are not asynchronous");
  return DISCARD;
}

FMU_EXPORT status fmi2GetRealStatus(instance *c, int kind, double *value) {
  if (!c) return ERROR;
  if (kind != 2) return DISCARD;
  *value = c->f->now.time;
  return OK;
}

FMU_EXPORT status fmi2GetIntegerStatus(instance *c, int kind, int *value) {
  (void)kind, (void)value;
  return c ? DISCARD : ERROR;
}

FMU_EXPORT status fmi2GetBooleanStatus(instance *c, int kind, int *value) {
  if (!c) return ERROR;
  if (kind != 3) return DISCARD;
  *value = 0;
  return OK;
}

FMU_EXPORT status fmi2GetStringStatus(instance *c, int kind, const char **value) {
  (void)kind, (void)value;
  return c ? DISCARD : ERROR;
}
