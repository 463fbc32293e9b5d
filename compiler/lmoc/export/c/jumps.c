/* What `engine/c/jump.c` asks an FMU where a value steps that the equations hold derivatives of: on the tape of
   `export/jumps.py`. */

#include "fmu_laws.h"

#include <stdio.h>

/* The rates with all laws open, and what is judged. */
static int values(void *own, const double *x, const int32_t *which, const double *given, double *out) {
  fmu *f = own;
  const fmu_model *m = f->model;
  const fmu_jumps *j = &m->jumps;
  double *w = f->w[JUMP];
  for (int64_t i = 0; i < j->kept; i++) w[j->to[i]] = f->w[RIGHT][j->from[i]];
  for (int64_t i = 0; i < m->states; i++) w[m->state[i]] = x[i];
  for (int64_t i = 0; i < j->given; i++) {
    w[j->which[i]] = which[i];
    w[j->own[i]] = given[i];
  }
  const int lost = lmoc_tape_run(f->now.time, w, f->tape + JUMP) & LMOC_FAILED;
  for (int64_t i = 0; i < m->states + j->judged; i++) out[i] = w[j->results[i]];
  return lost;
}

int64_t fmu_jump_room(const fmu_model *m) { return 6*m->jumps.count + 2*m->jumps.given + 2*m->states; }

static int read_at(fmu *f, double time, double *out) {
  if (fmu_look(f, time, f->x)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < f->model->jumps.count; i++) out[i] = f->w[LOOK][f->model->jumps.registers[i]];
  return FMU_GOOD;
}

static int refused(fmu *f, int status, int64_t first, const double *old, const double *change) {
  char text[600];
  snprintf(text, sizeof text, "'%.300s' jumps from %.6g to %.6g at t = %.6g s, and %s", f->model->jumps.names[first],
           old[first], old[first] + change[first], f->now.time, lmoc_jump_reason(status));
  return fmu_refused(f, text);
}

/* What the values in `f->step`, (4, count), do to the states. */
static int step(fmu *f) {
  const fmu_model *m = f->model;
  const fmu_jumps *j = &m->jumps;
  const int64_t n = m->states;
  double *sides = f->step + 4*j->count, *old = sides + 2*j->count, *change = old + j->given, *moved = change + j->given,
         *before = moved + n;
  char text[500];
  int64_t first = 0;
  int some = 0;
  memset(old, 0, (size_t)(2*j->given) * sizeof(double));
  if (!lmoc_steps_between(j->count, f->step, sides, change)) return FMU_GOOD;
  memcpy(old, sides, (size_t)j->count * sizeof(double));
  while (change[first] == 0) first++;
  const lmoc_jump jump = {n, j->given, j->rows, j->judged, j->lower, j->upper, j->origin, j->second, j->ledger, f, values};
  const int status = lmoc_jump_states(&jump, old, change, f->x, moved);
  if (status) return refused(f, status, first, old, change);
  for (int64_t i = 0; i < n; i++) some |= moved[i] != 0;
  if (!some) return FMU_GOOD;
  memcpy(before, f->x, (size_t)n * sizeof(double));
  for (int64_t i = 0; i < n; i++) f->x[i] += moved[i];
  fmu_changed(f);
  f->now.jumped = 1;
  snprintf(text, sizeof text, "t = %.15g s: %.300s: step from %.6g to %.6g", f->now.time, j->names[first], old[first],
           old[first] + change[first]);
  f->note(f->owner, text);
  return m->laws.laws.count ? fmu_law_strike(f, before) : FMU_GOOD;
}

int fmu_discrete_steps(fmu *f, const double *before) {
  const int64_t count = f->model->jumps.count, size = count * (int64_t)sizeof(double);
  int found;
  if (!count) return FMU_GOOD;
  for (int64_t i = 0; i < f->e.discrete; i++) f->at_event[i] = f->e.v[f->e.own[i]];
  for (int64_t i = 0; i < f->e.discrete; i++) f->e.v[f->e.own[i]] = before[i];
  found = read_at(f, f->now.time, f->step);
  for (int64_t i = 0; i < f->e.discrete; i++) f->e.v[f->e.own[i]] = f->at_event[i];
  if (found || (found = read_at(f, f->now.time, f->step + 2*count))) return found;
  memcpy(f->step + count, f->step, size);
  memcpy(f->step + 3*count, f->step + 2*count, size);
  return step(f);
}

int fmu_input_steps(fmu *f) {
  static const double places[] = {-1, -2, 1, 2};
  const int64_t count = f->model->jumps.count;
  int found = FMU_GOOD;
  for (; !found && fmu_next_break(f) <= f->now.time; f->now.first_break++) {
    const double at = fmu_next_break(f), aside = lmoc_beside_step(at);
    if (!count || at < f->now.begin) continue;
    for (int k = 0; k < 4 && !found; k++) found = read_at(f, at + places[k] * aside, f->step + k*count);
    if (!found) found = step(f);
    if (f->model->laws.laws.count) f->now.parted = 1; /* what is closed may be so no longer */
  }
  fmu_changed(f);
  return found;
}
