/* What `engine/c/law_run.c` asks an FMU, and what it is told: on the tapes of `export/laws.py`. */

#include "fmu_laws.h"

#include <stdio.h>

static const double MOMENT = 1e-10;  /* share of the run within which laws that change without end chatter */
static const double DRIFT = 0.1;     /* of the tolerance: from there on the states are moved onto what is closed */

/* ------------------------------------------------------------------ quantities */

/* Nonlinear blocks, such as the closures of loops, begin where those of the motion are: these are followed on the way. */
static int contact_at(void *own, double time, const double *x, const lmoc_settled *mode, double *values) {
  fmu *f = own;
  const int32_t *unknown = f->model->unknown;
  if (f->call.remembered && fmu_solve(f, time, x)) return LMOC_HELD_UP;
  for (int64_t i = 0; i < f->call.remembered; i++)
    f->w[BY_FORCE][unknown[i]] = f->w[BY_STATE][unknown[i]] = f->w[RIGHT][unknown[i]];
  lmoc_free_at(&f->scene, time, x, mode, values);
  if (!f->scene.lost) return LMOC_SOLVED;
  fmu_lost(f);
  return LMOC_HELD_UP;
}

void fmu_law_given(fmu *f) {
  const fmu_laws *l = &f->model->laws;
  for (int64_t i = 0; i < l->given; i++)
    f->w[BY_FORCE][l->given_registers[i]] = f->w[BY_STATE][l->given_registers[i]] = f->w[RIGHT][l->given_registers[i]];
}

void fmu_law_look(fmu *f) {
  fmu_law_given(f);
  lmoc_law_look(&f->laws, f->now.time, f->x);
}

void fmu_law_compare(fmu *f) {
  int found;
  const int below = lmoc_law_parts(&f->laws, f->now.time, f->x, &found) != LMOC_SOLVED;
  f->now.parted |= found || below; /* what is below zero is refused when it happens */
}

/* Levels that are rounding alone are zero. */
static int exact(void *own, double time, const double *x, const lmoc_flag *which, double *bias) {
  const fmu *f = own;
  (void)time, (void)x;
  for (int64_t i = 0; i < f->laws.k.laws.count; i++)
    if (which[i] && fabs(bias[i]) <= f->model->laws.noise[i]) bias[i] = 0;
  return 0;
}

/* The closures of loops, which hold whatever is closed. */
static int tie(void *own, double time, const double *x, double *value, double *slope) {
  return lmoc_closure_rows(&((fmu *)own)->closures, time, x, value, slope);
}

void fmu_law_ask(fmu *f) {
  const fmu_model *m = f->model;
  const fmu_laws *l = &m->laws;
  const int64_t n = l->laws.count;
  f->laws.k = (lmoc_kinematics){l->laws, m->states, l->unilateral, l->ledger, f->restitution, f->errors, f->unresolved,
                                0, f,
                                contact_at, exact, lmoc_closure_count(&f->closures), tie};
  f->laws.curved = l->curved;
  f->laws.linear = l->linear;
  f->laws.position = l->position;
  f->laws.limits = f->known + 4*n;
  f->laws.noise = l->noise;
  f->laws.work = f->laws.heat = -1;
  f->laws.moment = MOMENT * m->span;
  f->scene = (lmoc_free_dynamics){n, m->states, -1, {l->by_force.result_count, l->by_state.result_count},
                                  {l->by_force.results, l->by_state.results}, {l->force_entry, l->state_entry},
                                  {f->w[BY_FORCE], f->w[BY_STATE]}, {f->tape + BY_FORCE, f->tape + BY_STATE}, m->state,
                                  l->quantity, f->known, l->inputs};
}

void fmu_law_parameters(fmu *f) {
  const fmu_laws *l = &f->model->laws;
  const double *w = f->w[PARAMETRIC];
  const int64_t n = l->laws.count;
  for (int64_t i = 0; i < 6*n; i++) f->known[i] = l->known[i] < 0 ? NAN : w[l->known[i]];
  for (int64_t i = 0; i < n; i++) f->restitution[i] = l->restitution[i] < 0 ? 0 : w[l->restitution[i]];
}

void fmu_law_mode(fmu *f) {
  const fmu_laws *l = &f->model->laws;
  const int64_t n = l->laws.count;
  double *w = f->w[RIGHT], *inputs = f->law_read;
  int changed = 0;
  lmoc_law_inputs(&f->laws, inputs);
  for (int64_t i = 0; i < 3*n; i++) {
    const int32_t at = l->inputs[i];
    if (at < 0 || w[at] == inputs[i]) continue;
    w[at] = inputs[i];
    changed = 1;
  }
  for (int64_t j = 0; j < f->model->states; j++) {
    if (l->held[j] < 0 || w[l->held[j]] == f->laws.held[j]) continue;
    w[l->held[j]] = f->laws.held[j];
    changed = 1;
  }
  if (changed) fmu_changed(f);
}

/* ------------------------------------------------------------------ what ends a mode */

int64_t fmu_law_roots(const fmu *f) { return 2 * f->model->laws.laws.count; }

static const double *read_of(fmu *f) {
  for (int64_t i = 0; i < 4 * f->model->laws.laws.count; i++) f->law_read[i] = f->w[LOOK][f->model->laws.read[i]];
  return f->law_read;
}

void fmu_law_indicators(fmu *f, double *out) {
  const int64_t n = f->model->laws.laws.count;
  double *found = f->laws.root;
  lmoc_law_values(&f->laws, 1, read_of(f), found);
  memcpy(out, found, (size_t)n * sizeof(double));
  found += n;
  for (int64_t i = 0; i < n; i++)
    out[n + i] = f->laws.closed[i] && !f->laws.k.laws.complementary[i] ? *found++ : 1;
  fmu_hop_indicators(f, out);
}

void fmu_law_watch(fmu *f) { lmoc_law_watch(&f->laws, read_of(f)); }

/* ------------------------------------------------------------------ what is said */

static void names_of(const fmu *f, const lmoc_flag *which, size_t size, char *text) {
  size_t at = 0;
  text[0] = 0;
  for (int64_t i = 0; i < f->laws.k.laws.count && at < size; i++)
    if (which[i]) at += (size_t)snprintf(text + at, size - at, "%s%s", at ? ", " : "", f->model->laws.names[i]);
}

static int refused(fmu *f, int status) {
  static const char *const reasons[] = {
    [LMOC_NO_FORCES] = "contradict each other: no forces keep them",
    [LMOC_NO_STATES] = "contradict each other: no states nearby satisfy them",
    [LMOC_NO_IMPULSES] = "contradict each other: no impulses keep them",
    [LMOC_OVERLAPS] = "have a negative gap",
    [LMOC_GAP_JUMPS] = "are closed, and their gap jumps below zero",
    [LMOC_CHATTERS] = "open and close without end",
    [LMOC_NO_END] = "and events change each other again and again",
  };
  char text[500], names[300];
  if (status == LMOC_HELD_UP) return f->failed;
  if (status == LMOC_NO_MEMORY) return fmu_refused(f, "there is no memory for the laws");
  names_of(f, f->laws.laws, sizeof names, names);
  snprintf(text, sizeof text, "the laws of %s %s at t = %.6g s", names, reasons[status], f->now.time);
  return fmu_refused(f, text);
}

static void note(const fmu *f) {
  const fmu_laws *l = &f->model->laws;
  char text[500];
  for (int64_t i = 0; i < l->laws.count; i++) {
    const int64_t kind = f->laws.kind[i];
    const char *word = kind == LMOC_ACCUMULATION ? "accumulation" : kind == LMOC_IMPACT ? "impact"
                       : kind == LMOC_CLOSING ? l->closings[i]
                       : f->laws.was[i] ? l->openings[i] : "reversal";
    if (kind == LMOC_NO_EVENT) continue;
    snprintf(text, sizeof text, "t = %.15g s: %.200s: %s, impulse %.9g, energy lost %.9g", f->laws.when[i], l->names[i], word,
             f->laws.impulse[i], f->laws.lost[i]);
    f->note(f->owner, text);
  }
}

/* ------------------------------------------------------------------ what happens */

/* What the integrator allows itself in a step; that of another tool has just begun, perhaps with order one, and what it
   does not resolve is not always foreseen (`fmu_hops.c`). */
static void allow(fmu *f) {
  fmu_allow(f);
  for (int64_t j = 0; j < f->model->states; j++) f->unresolved[j] = f->now.surprised ? f->errors[j] : 0;
  f->laws.k.guessed = f->now.surprised;
}

int fmu_law_begin(fmu *f, int for_good) {
  double *x = f->moved;
  memcpy(x, f->x, (size_t)f->model->states * sizeof(double));
  lmoc_law_open(&f->laws);
  fmu_settle(f);
  fmu_law_given(f);
  allow(f);
  f->failed = FMU_NO_VALUE;
  int status = lmoc_law_renew(&f->laws);
  if (!status) status = lmoc_law_start(&f->laws, f->now.time, x);
  if (status) return refused(f, status);
  fmu_law_mode(f);
  if (!for_good) return FMU_GOOD;
  note(f);
  memcpy(f->x, x, (size_t)f->model->states * sizeof(double));
  fmu_changed(f);
  return FMU_GOOD;
}

int fmu_law_happen(fmu *f, const lmoc_flag *which) {
  const size_t size = (size_t)f->model->states * sizeof(double);
  allow(f);
  memcpy(f->before, f->x, size);
  f->failed = FMU_NO_VALUE;
  const int status = lmoc_law_happen(&f->laws, f->now.time, f->x, which, f->now.parted);
  f->now.parted = 0;
  if (status) return refused(f, status);
  note(f);
  f->now.jumped |= memcmp(f->before, f->x, size) != 0;
  fmu_law_mode(f);
  fmu_changed(f);
  return FMU_GOOD;
}

int fmu_law_strike(fmu *f, const double *before) {
  fmu_law_given(f);
  f->failed = FMU_NO_VALUE;
  const int status = lmoc_law_strike(&f->laws, f->now.time, before, f->x);
  fmu_changed(f);
  return status ? refused(f, status) : FMU_GOOD;
}

static int renew(void *own) {
  fmu_settle(own);
  fmu_law_given(own);
  return 0;
}

static int happened(void *own) {
  note(own);
  fmu_law_mode(own);
  fmu_changed(own);
  return 0;
}

int fmu_law_settle(fmu *f, int (*settle)(void *own, double time, double *x)) {
  const lmoc_discrete discrete = {f, renew, happened, settle};
  const size_t size = (size_t)f->model->states * sizeof(double);
  allow(f);
  memcpy(f->law_moved, f->x, size);
  f->failed = FMU_NO_VALUE;
  const int status = lmoc_law_settle(&f->laws, &discrete, f->now.time, f->law_before, f->x);
  if (status == LMOC_NO_END) memset(f->laws.laws, 1, (size_t)f->model->laws.laws.count);
  if (status) return refused(f, status);
  f->now.jumped |= memcmp(f->law_moved, f->x, size) != 0;
  return FMU_GOOD;
}

int fmu_law_keep(void *own, double time, double *x) {
  fmu *f = own;
  fmu_law_given(f);
  return lmoc_law_keep(&f->laws, time, DRIFT * f->now.rtol, x);
}
