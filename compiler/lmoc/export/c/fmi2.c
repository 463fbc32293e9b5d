/* The functions of FMI 2.0 (fmi-standard.org), declared here by their names and types. */

#include "fmu.h"

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
  int logging;
} instance;

static void tell(void *own, const char *text) {
  instance *c = own;
  if (c->calls.log) c->calls.log(c->calls.environment, c->name, ERROR, "logStatusError", "%s", text);
}

static void warn(void *own, const char *text) {
  instance *c = own;
  if (c->calls.log) c->calls.log(c->calls.environment, c->name, WARNING, "logStatusWarning", "%s", text);
}

static void note(void *own, const char *text) {
  instance *c = own;
  if (c->calls.log && c->logging) c->calls.log(c->calls.environment, c->name, OK, "logEvents", "%s", text);
}

#define FMI(name) fmi2##name
#define fmi2GetFMUState fmi2GetFMUstate
#define fmi2SetFMUState fmi2SetFMUstate
#define fmi2FreeFMUState fmi2FreeFMUstate
#define fmi2SerializedFMUStateSize fmi2SerializedFMUstateSize
#define fmi2SerializeFMUState fmi2SerializeFMUstate
#define fmi2DeserializeFMUState fmi2DeSerializeFMUstate
#define fmi2GetContinuousStateDerivatives fmi2GetDerivatives
typedef int boolean;
#include "fmi.h"

FMU_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMU_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

FMU_EXPORT instance *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                                     const callbacks *calls, int visible, int logging) {
  (void)resources, (void)visible;
  instance *c = calloc(1, sizeof *c);
  if (!c) return 0;
  c->logging = logging;
  if (calls) c->calls = *calls;
  snprintf(c->name, sizeof c->name, "%s", name ? name : "");
  return filled(c, token, type == 1);
}

/* ------------------------------------------------------------------ phases */

FMU_EXPORT status fmi2SetupExperiment(instance *c, int has_tolerance, double tolerance, double start, int has_stop,
                                      double stop) {
  (void)has_stop, (void)stop;
  ALLOW(FMU_FRESH);
  return set_up(c, has_tolerance, tolerance, start);
}

FMU_EXPORT status fmi2EnterInitializationMode(instance *c) {
  ALLOW(FMU_FRESH);
  c->f->now.phase = FMU_INITIALIZING;
  return OK;
}

/* ------------------------------------------------------------------ values */

FMU_EXPORT status fmi2GetReal(instance *c, const uint32_t r[], size_t n, double values[]) {
  ALLOW(READABLE);
  return get_values(c, r, n, values);
}

FMU_EXPORT status fmi2SetReal(instance *c, const uint32_t r[], size_t n, const double values[]) {
  ALLOW(WRITABLE);
  return set_values(c, r, n, values);
}

READ_ONLY(Integer, int, FMU_INTEGER,)
READ_ONLY(Boolean, int, FMU_BOOLEAN,)
NONE(String, text,)

/* ------------------------------------------------------------------ derivatives in a direction */

FMU_EXPORT status fmi2GetDirectionalDerivative(instance *c, const uint32_t unknowns[], size_t rows,
                                               const uint32_t knowns[], size_t columns, const double seed[],
                                               double out[]) {
  ALLOW(RUNNING | FMU_ENDED);
  return done(fmu_directional(c->f, unknowns, rows, knowns, columns, seed, out, 0));
}

/* ------------------------------------------------------------------ model exchange */

FMU_EXPORT status fmi2NewDiscreteStates(instance *c, event_info *info) {
  ALLOW(FMU_EVENT);
  double next = INFINITY;
  const status found = updated(c, &next);
  *info = (event_info){.has_next = next < INFINITY, .next = next, .terminate = c->f->now.ended,
                       .values_changed = c->f->now.anew};
  return found;
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
  ALLOW(FMU_STEPPING);
  const status found = step_from(c, time, step);
  return !found && c->f->now.ended ? DISCARD : found;
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
  *value = c->f->now.ended;
  return OK;
}

FMU_EXPORT status fmi2GetStringStatus(instance *c, int kind, const char **value) {
  (void)kind, (void)value;
  return c ? DISCARD : ERROR;
}
