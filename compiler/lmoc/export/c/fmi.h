/* The functions that FMI 2.0 and 3.0 share but for the spelling of their names: included once by `fmi2.c` or `fmi3.c`,
   behind what they say of a version: `FMI(name)` makes a name of a function, `boolean` is its type, `instance` holds an
   `fmu *f`, and `tell` passes on a message. */

#include <stdio.h>
#include <stdlib.h>

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

#define ALLOW(phases) do { if (!allowed(c, phases, __func__)) return ERROR; } while (0)
#define STATES(n) do { if ((int64_t)(n) != c->f->model->states) return wrong(c, "there are not as many states"); } while (0)
#define RUNNING (FMU_INITIALIZING | FMU_EVENT | FMU_CONTINUOUS | FMU_STEPPING)
#define READABLE (FMU_FRESH | RUNNING | FMU_ENDED | FMU_BROKEN)
#define WRITABLE (FMU_FRESH | RUNNING)
#define ANY (READABLE | FMU_CONFIGURING)

FMU_EXPORT status FMI(SetDebugLogging)(instance *c, boolean on, size_t n, const char *const categories[]) {
  if (!c) return ERROR;
  int events = !n; /* of which one can be told; the others are errors and warnings */
  for (size_t i = 0; i < n && categories; i++) events |= !strcmp(categories[i], "logEvents");
  if (events) c->logging = on;
  return OK;
}

/* Give a new instance its scene; 0 where it cannot have it. */
static instance *filled(instance *c, const char *token, int co_simulation) {
  if (!token || strcmp(token, lmoc_fmu_model.token)) tell(c, "the instantiation token (GUID) is another one");
  else c->f = fmu_new(&lmoc_fmu_model, co_simulation, c, tell, warn, note);
  if (c->f) return c;
  free(c);
  return 0;
}

FMU_EXPORT void FMI(FreeInstance)(instance *c) {
  if (!c) return;
  fmu_free(c->f);
  free(c);
}

/* ------------------------------------------------------------------ phases */

static status set_up(instance *c, int has_tolerance, double tolerance, double start) {
  if (!(start * 0 == 0)) return wrong(c, "the start time is no finite number");
  if (has_tolerance && tolerance > 0 && tolerance < 1) c->f->now.rtol = tolerance;
  fmu_set_time(c->f, start);
  c->f->now.begin = start;
  return OK;
}

FMU_EXPORT status FMI(ExitInitializationMode)(instance *c) {
  ALLOW(FMU_INITIALIZING);
  if (fmu_fits(c->f) || fmu_begin(c->f, 1) || fmu_accept(c->f)) {
    c->f->now.phase = FMU_BROKEN;
    return ERROR;
  }
  c->f->now.phase = c->f->now.co_simulation ? FMU_STEPPING : FMU_EVENT;
  return OK;
}

FMU_EXPORT status FMI(EnterEventMode)(instance *c) {
  ALLOW(FMU_CONTINUOUS);
  c->f->now.phase = FMU_EVENT;
  return OK;
}

FMU_EXPORT status FMI(EnterContinuousTimeMode)(instance *c) {
  ALLOW(FMU_EVENT);
  c->f->now.phase = FMU_CONTINUOUS;
  return OK;
}

FMU_EXPORT status FMI(Terminate)(instance *c) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS | FMU_STEPPING | FMU_BROKEN);
  c->f->now.phase = FMU_ENDED;
  return OK;
}

FMU_EXPORT status FMI(Reset)(instance *c) {
  ALLOW(ANY);
  fmu_reset(c->f);
  return OK;
}

/* ------------------------------------------------------------------ values */

static int is_of(instance *c, uint32_t reference, int type) {
  const fmu_model *m = c->f->model;
  if (!reference ? type == FMU_REAL : (int64_t)reference > m->variables || m->type[reference - 1] == type) return 1;
  tell(c, "a variable has values of another type");
  return 0;
}

static status get_values(instance *c, const uint32_t r[], size_t n, double values[]) {
  int found = FMU_GOOD;
  for (size_t i = 0; i < n; i++) {
    const int own = is_of(c, r[i], FMU_REAL) ? fmu_get(c->f, r[i], values + i) : FMU_WRONG;
    if (own > found) found = own;
  }
  return done(found);
}

static status set_values(instance *c, const uint32_t r[], size_t n, const double values[]) {
  for (size_t i = 0; i < n; i++)
    if (fmu_set(c->f, r[i], values[i])) return ERROR;
  return OK;
}

/* Discrete variables that are whole numbers or Boolean: they can be read. `...`: what follows the values. */
#define READ(name, type, of) \
  static status get_##of##_values(instance *c, const uint32_t r[], size_t n, type values[]) { \
    int found = FMU_GOOD; \
    for (size_t i = 0; i < n; i++) { \
      double value = 0; \
      const int own = is_of(c, r[i], of) ? fmu_get(c->f, r[i], &value) : FMU_WRONG; \
      values[i] = (type)value; \
      if (own > found) found = own; \
    } \
    return done(found); \
  }
#define READ_ONLY(name, type, of, ...) \
  READ(name, type, of) \
  FMU_EXPORT status FMI(Get##name)(instance *c, const uint32_t r[], size_t n, type values[] __VA_ARGS__) { \
    if (!n && c) return OK; \
    ALLOW(READABLE); \
    return get_##of##_values(c, r, n, values); \
  } \
  FMU_EXPORT status FMI(Set##name)(instance *c, const uint32_t r[], size_t n, const type values[] __VA_ARGS__) { \
    (void)r, (void)values; \
    return n ? wrong(c, "variables of type " #name " are calculated, and cannot be set") : OK; \
  }

/* There are no others. */
#define NONE(name, type, ...) \
  FMU_EXPORT status FMI(Get##name)(instance *c, const uint32_t r[], size_t n, type values[] __VA_ARGS__) { \
    (void)r, (void)values; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  } \
  FMU_EXPORT status FMI(Set##name)(instance *c, const uint32_t r[], size_t n, const type values[] __VA_ARGS__) { \
    (void)r, (void)values; \
    return n ? wrong(c, "there are no variables of type " #name) : OK; \
  }
typedef const char *text;

/* ------------------------------------------------------------------ saved states */

typedef struct {
  size_t size;
  unsigned char bytes[];
} saved;

FMU_EXPORT status FMI(GetFMUState)(instance *c, saved **state) {
  ALLOW(ANY);
  const size_t size = fmu_bytes(c->f);
  if (!*state) *state = malloc(sizeof(saved) + size);
  if (!*state) return wrong(c, "there is no memory");
  (*state)->size = size;
  fmu_save(c->f, (*state)->bytes);
  return OK;
}

FMU_EXPORT status FMI(SetFMUState)(instance *c, saved *state) {
  ALLOW(ANY);
  return state ? done(fmu_restore(c->f, state->bytes, state->size)) : wrong(c, "there is no saved state");
}

FMU_EXPORT status FMI(FreeFMUState)(instance *c, saved **state) {
  if (!c) return ERROR;
  if (state) {
    free(*state);
    *state = 0;
  }
  return OK;
}

FMU_EXPORT status FMI(SerializedFMUStateSize)(instance *c, saved *state, size_t *size) {
  if (!c || !state) return wrong(c, "there is no saved state");
  *size = state->size;
  return OK;
}

FMU_EXPORT status FMI(SerializeFMUState)(instance *c, saved *state, unsigned char bytes[], size_t size) {
  if (!c || !state || size < state->size) return wrong(c, "a saved state does not fit");
  memcpy(bytes, state->bytes, state->size);
  return OK;
}

FMU_EXPORT status FMI(DeserializeFMUState)(instance *c, const unsigned char bytes[], size_t size, saved **state) {
  if (!c || size != fmu_bytes(c->f)) return wrong(c, "the saved state is one of another FMU");
  saved *made = realloc(*state, sizeof(saved) + size);
  if (!made) return wrong(c, "there is no memory");
  made->size = size;
  memcpy(made->bytes, bytes, size);
  *state = made;
  return OK;
}

/* ------------------------------------------------------------------ model exchange */

FMU_EXPORT status FMI(CompletedIntegratorStep)(instance *c, boolean no_way_back, boolean *enter, boolean *terminate) {
  (void)no_way_back;
  ALLOW(FMU_CONTINUOUS);
  *enter = *terminate = 0;
  const int found = fmu_accept(c->f);
  *enter = !found && fmu_passed(c->f);
  return done(found);
}

FMU_EXPORT status FMI(SetTime)(instance *c, double time) {
  ALLOW(FMU_EVENT | FMU_CONTINUOUS);
  if (!(time * 0 == 0)) return wrong(c, "the time is no finite number");
  fmu_set_time(c->f, time);
  return OK;
}

FMU_EXPORT status FMI(SetContinuousStates)(instance *c, const double x[], size_t n) {
  ALLOW(FMU_CONTINUOUS);
  STATES(n);
  fmu_set_states(c->f, x);
  return OK;
}

FMU_EXPORT status FMI(GetContinuousStateDerivatives)(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED);
  STATES(n);
  return done(fmu_derivatives(c->f, out));
}

FMU_EXPORT status FMI(GetEventIndicators)(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED);
  if ((int64_t)n != fmu_roots(c->f)) return wrong(c, "there are not as many event indicators");
  return done(n ? fmu_indicators(c->f, c->f->now.time, c->f->x, out) : FMU_GOOD);
}

/* All that happens at an event, and when the next one comes: infinity where none is known. */
static status updated(instance *c, double *next) {
  int found = fmu_fits(c->f);
  if (!found) found = fmu_event(c->f);
  *next = fmu_next(c->f);
  return done(found ? found : fmu_holds(c->f));
}

FMU_EXPORT status FMI(GetContinuousStates)(instance *c, double x[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED);
  STATES(n);
  return done(fmu_states(c->f, x));
}

FMU_EXPORT status FMI(GetNominalsOfContinuousStates)(instance *c, double out[], size_t n) {
  ALLOW(RUNNING | FMU_ENDED);
  STATES(n);
  memcpy(out, c->f->model->nominal, n * sizeof(double));
  return OK;
}

/* ------------------------------------------------------------------ co-simulation */

static status step_from(instance *c, double time, double step) {
  fmu *f = c->f;
  if (!(step > 0 && step * 0 == 0)) return wrong(c, "a step has a positive length");
  if (f->now.ended) return wrong(c, "the model has ended its run");
  if (!(time * 0 == 0 && fabs(time - f->now.time) <= 1e-9 * (step + fabs(time))))
    return wrong(c, "the last step has not led there");
  if (!fmu_advance(f, time + step)) return OK;
  f->now.phase = FMU_BROKEN;
  return ERROR;
}
