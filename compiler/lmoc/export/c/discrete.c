/* The discrete equations of a scene at an instant, as `numerics/events/discrete_state.py` solves them in a run, on the tapes of
   `export/instants.py`: in turn with the continuous ones, until nothing changes. */

#include "discrete.h"

static const double ULP = 0x1p-52, ZERO = 1e-10, NOISES = 32, EQUAL = 1e-13;
enum { TRIALS = 1024, FEW = 3, SETTLING = 20, MOST_AT_ONCE = 64 };

double *fmu_in_history(fmu *f, int64_t k) { return f->history + k*f->model->events.discrete; }

int fmu_unsettled(fmu *f) {
  return fmu_refused(f, "no values of the discrete variables satisfy all equations at an event");
}

int fmu_rounded(const fmu_events *e, int64_t zero) { return e->op[e->of_zero[zero]] == FLOOR; }

/* ------------------------------------------------------------------ looking */

double fmu_height(const fmu_events *e, int64_t zero, double value) {
  return fabs(fmu_rounded(e, zero) ? value - nearbyint(value) : value);
}

double fmu_value(const fmu *f, int64_t zero) { return f->w[LOOK][f->model->events.zero[zero]]; }

/* How much rounding there is in functions that are zero but for it, seen where the states change by it. What is exactly
   zero and stays that does not pass through zero, and has no margin. */
static int widen(fmu *f, double t, const double *x) {
  const fmu_events *e = &f->model->events;
  const int64_t n = f->model->states;
  double size = 1, *noise = f->noise, *stays = noise + e->zeros, *beside = f->moved + n;
  int some = 0;
  for (int64_t i = 0; i < n; i++) size = fmax(size, fabs(x[i]));
  for (int64_t k = 0; k < e->zeros; k++) size = fmax(size, fabs(f->zero[k]));
  for (int64_t k = 0; k < e->zeros; k++) {
    const double h = fabs(f->zero[k]);
    noise[k] = h <= ZERO*size && (h > 0 || f->margin[k] > 0) && !fmu_rounded(e, k) ? 0 : -1;
    stays[k] = h == 0;
    some |= noise[k] == 0;
  }
  if (!some) return FMU_GOOD;
  for (int alternating = 0; alternating < 2; alternating++)
    for (int additive = 0; additive < 2; additive++) {
      for (int64_t i = 0; i < n; i++) {
        const double by = (alternating && i % 2 == 0 ? -1 : 1) * ULP;
        beside[i] = additive ? x[i] + by * fmax(fabs(x[i]), 1) : x[i] * (1 + by);
      }
      if (fmu_look(f, additive ? t + ULP * fmax(fabs(t), 1) : t, beside)) return FMU_NO_VALUE;
      for (int64_t k = 0; k < e->zeros; k++) {
        if (additive) stays[k] *= fmu_value(f, k) == 0;
        else if (noise[k] >= 0) noise[k] = fmax(noise[k], fabs(fmu_value(f, k) - f->zero[k]));
      }
    }
  for (int64_t k = 0; k < e->zeros; k++)
    if (noise[k] >= 0) f->margin[k] = stays[k] != 0 ? 0 : fmax(f->margin[k], NOISES * noise[k]);
  return fmu_look(f, t, x);
}

/* Take the continuous values at a place. */
int fmu_take(fmu *f, double t, const double *x) {
  const fmu_events *e = &f->model->events;
  if (fmu_look(f, t, x)) return FMU_NO_VALUE;
  for (int64_t k = 0; k < e->zeros; k++) f->zero[k] = fmu_value(f, k);
  const int found = widen(f, t, x);
  for (int64_t i = 0; i < e->seen; i++) f->w[ASSIGN][e->seen_registers[i]] = f->w[LOOK][e->seen_registers[i]];
  return found;
}

void fmu_remember(fmu *f) {
  const fmu_events *e = &f->model->events;
  for (int64_t i = 0; i < e->before; i++)
    f->d[e->past[i]] = e->now[i] >= 0 ? f->d[e->now[i]] : f->w[LOOK][e->source[i]];
}

/* ------------------------------------------------------------------ discrete equations */

static double decide(int op, double zero) { return op == FLOOR ? floor(zero) : op == GT ? zero > 0 : zero >= 0; }

/* A relation from its zero function; within the margin of a crossing it stays as it is now. */
double fmu_decided(const fmu *f, int64_t zero, double now) {
  const int op = f->model->events.op[f->model->events.of_zero[zero]];
  const double value = f->zero[zero], beside = op == FLOOR ? fmax(now - value, value - now - 1) : fabs(value);
  return beside < f->margin[zero] ? now : decide(op, value);
}

/* A relation of time, as it is right behind the present time; at the start as it is written. */
static double timed(const fmu *f, int op, double slope, double offset) {
  const double t = f->now.time, zero = slope*t + offset, nearest = op == FLOOR ? nearbyint(zero) : 0;
  const int at = !f->now.literal && fabs(zero - nearest) <= fabs(slope) * near_to(t) && slope != 0;
  return decide(op, at ? nearest + (slope > 0 ? 0.5 : -0.5) : zero);
}

void fmu_run(fmu *f, int tape) {
  const fmu_events *e = &f->model->events;
  for (int64_t i = 0; i < e->discrete; i++) f->w[tape][e->registers[i]] = f->d[i];
  lmoc_tape_run(f->now.time, f->w[tape], f->tape + tape);
}

/* Carry out the discrete equations in their order. */
void fmu_assign(fmu *f) {
  const fmu_events *e = &f->model->events;
  if (e->lines) fmu_run(f, LINES);
  for (int64_t r = 0; r < e->relations; r++) {
    const int64_t row = e->row[r], line = -1 - row;
    double *target = f->d + e->target[r];
    if (row >= 0) {
      if (!f->now.supposing || !f->supposed[e->target[r]]) *target = fmu_decided(f, row, *target);
    } else *target = timed(f, e->op[r], f->w[LINES][e->slope[line]], f->w[LINES][e->offset[line]]);
  }
  fmu_run(f, ASSIGN);
  for (int64_t i = 0; i < e->assigned; i++) f->d[e->assigned_ones[i]] = f->w[ASSIGN][e->registers[e->assigned_ones[i]]];
}

/* Solve once for the continuous values, then for the discrete ones. Returns how many have changed, -1 where there is no
   value. */
static int64_t turn(fmu *f, const double *x, double *mask) {
  const int64_t count = f->model->events.discrete;
  double *before = fmu_in_history(f, FMU_BEFORE);
  int64_t changed = 0;
  if (fmu_take(f, f->now.time, x)) return -1;
  memcpy(before, f->d, count * sizeof(double));
  fmu_assign(f);
  for (int64_t i = 0; i < count; i++)
    if (differ(before[i], f->d[i])) {
      changed++;
      if (mask) mask[i] = 1;
    }
  return changed;
}

/* Whether the other values come to agree with those that are being tried, and these with their functions. */
static int agrees(fmu *f, const double *x, const int64_t *zeros, int64_t count) {
  const fmu_events *e = &f->model->events;
  int64_t changed = 1;
  double largest = 1;
  for (int k = 0; k < SETTLING && changed > 0; k++) changed = turn(f, x, 0);
  if (changed) return 0;
  for (int64_t k = 0; k < e->zeros; k++) largest = fmax(largest, fabs(f->zero[k]));
  for (int64_t i = 0; i < count; i++) {
    const int64_t r = e->of_zero[zeros[i]];
    const double value = f->zero[zeros[i]];
    if ((decide(e->op[r], value) != 0) != (f->d[e->target[r]] > 0) &&
        !(fabs(value) <= fmax(f->margin[zeros[i]], EQUAL * largest))) return 0;
  }
  return 1;
}

/* Try values of relations, those with the fewest changes first. */
static int try_some(fmu *f, const double *x, const int64_t *zeros, int64_t count, int64_t most) {
  const fmu_events *e = &f->model->events;
  int64_t chosen[MOST_AT_ONCE];
  int trials = 0, found = 0;
  memset(f->supposed, 0, e->discrete * sizeof(double));
  for (int64_t i = 0; i < count; i++) f->supposed[e->target[e->of_zero[zeros[i]]]] = 1;
  f->now.supposing = 1;
  for (int64_t size = 0; size <= most && size <= count && size <= MOST_AT_ONCE && !found; size++) {
    for (int64_t i = 0; i < size; i++) chosen[i] = i;
    for (int more = 1; more && trials < TRIALS && !found; trials++) {
      memcpy(f->d, fmu_in_history(f, FMU_BEGUN), e->discrete * sizeof(double));
      for (int64_t i = 0; i < size; i++) {
        double *own = f->d + e->target[e->of_zero[zeros[chosen[i]]]];
        *own = 1 - *own;
      }
      found = agrees(f, x, zeros, count);
      int64_t last = size - 1;  /* the next combination */
      while (last >= 0 && chosen[last] == count - size + last) last--;
      more = last >= 0;
      if (more) chosen[last]++;
      for (int64_t i = last + 1; more && i < size; i++) chosen[i] = chosen[i - 1] + 1;
    }
  }
  f->now.supposing = 0;
  return found;
}

/* Where the values repeat each other, those of the relations that flip are tried; then a few of all those in the
   equations of what has changed. */
static int try_relations(fmu *f, const double *x) {
  const fmu_events *e = &f->model->events;
  double *flipped = f->flipped, *read = flipped + e->discrete;
  int64_t *zeros = f->chosen, count = 0;
  for (int64_t k = 0; k < e->zeros; k++)
    if (!fmu_rounded(e, k) && flipped[e->target[e->of_zero[k]]] != 0) zeros[count++] = k;
  if (try_some(f, x, zeros, count, count)) return 1;
  memset(read, 0, e->discrete * sizeof(double));
  for (int64_t i = 0; i < e->assigned; i++)
    if (flipped[e->assigned_ones[i]] != 0)
      for (int64_t j = e->first_read[i]; j < e->first_read[i + 1]; j++) read[e->read[j]] = 1;
  count = 0;
  for (int64_t k = 0; k < e->zeros; k++)
    if (!fmu_rounded(e, k) && read[e->target[e->of_zero[k]]] != 0) zeros[count++] = k;
  return try_some(f, x, zeros, count, FEW);
}

/* Find discrete values that agree with the continuous ones. */
int fmu_settle(fmu *f, const double *x) {
  const int64_t count = f->model->events.discrete;
  memcpy(fmu_in_history(f, FMU_BEGUN), f->d, count * sizeof(double));
  memset(f->flipped, 0, count * sizeof(double));
  for (int64_t seen = 0, repeated = 0; seen < FMU_ROUNDS && !repeated; seen++) {
    const int64_t changed = turn(f, x, f->flipped);
    if (changed < 0) return FMU_NO_VALUE;
    if (!changed) return FMU_GOOD;
    for (int64_t k = 0; k < seen && !repeated; k++)
      repeated = !memcmp(fmu_in_history(f, k), f->d, count * sizeof(double));
    memcpy(fmu_in_history(f, seen), f->d, count * sizeof(double));
  }
  return try_relations(f, x) ? FMU_GOOD : fmu_unsettled(f);
}
