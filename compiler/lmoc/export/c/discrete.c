/* What `engine/c/instant.c` asks an FMU: values at a place, on the tapes of `export/instants.py`, and others where solving
   in turn repeats itself. */

#include "discrete.h"

static const double ULP = 0x1p-52, ZERO = 1e-10, NOISES = 32, EQUAL = 1e-13;
enum { TRIALS = 1024, FEW = 3, SETTLING = 20, MOST_AT_ONCE = 64 };

int fmu_unsettled(fmu *f) {
  return fmu_refused(f, "no values of the discrete variables satisfy all equations at an event");
}

/* ------------------------------------------------------------------ looking */

double fmu_value(const fmu *f, int64_t zero) { return f->w[LOOK][f->model->events.zero[zero]]; }

static int look(lmoc_instant *e, double t, const double *x) {
  fmu *f = e->owner;
  const fmu_events *m = &f->model->events;
  if (fmu_look(f, t, x)) return LMOC_NO_VALUE;
  for (int64_t k = 0; k < e->zeros; k++) e->zero[k] = fmu_value(f, k);
  for (int64_t i = 0; i < m->seen; i++) e->v[m->seen_registers[i]] = f->w[LOOK][m->seen_registers[i]];
  return LMOC_SETTLED;
}

/* How much rounding there is in functions that are zero but for it, seen where the states change by it. What is exactly
   zero and stays that does not pass through zero, and has no margin. */
static int widen(lmoc_instant *e, double t, const double *x) {
  fmu *f = e->owner;
  const int64_t n = f->model->states;
  double size = 1, *noise = f->noise, *stays = noise + e->zeros, *beside = f->moved + n;
  int some = 0;
  for (int64_t i = 0; i < n; i++) size = fmax(size, fabs(x[i]));
  for (int64_t k = 0; k < e->zeros; k++) size = fmax(size, fabs(e->zero[k]));
  for (int64_t k = 0; k < e->zeros; k++) {
    const double h = fabs(e->zero[k]);
    noise[k] = h <= ZERO*size && (h > 0 || e->margin[k] > 0) && !lmoc_rounded(e, k) ? 0 : -1;
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
        else if (noise[k] >= 0) noise[k] = fmax(noise[k], fabs(fmu_value(f, k) - e->zero[k]));
      }
    }
  for (int64_t k = 0; k < e->zeros; k++)
    if (noise[k] >= 0) e->margin[k] = stays[k] != 0 ? 0 : fmax(e->margin[k], NOISES * noise[k]);
  return fmu_look(f, t, x);
}

/* ------------------------------------------------------------------ trials */

/* Whether the other values come to agree with those that are being tried, and these with their functions. */
static int agrees(lmoc_instant *e, const double *x, const int64_t *zeros, int64_t count) {
  int64_t changed = 1;
  double largest = 1;
  for (int k = 0; k < SETTLING && changed > 0; k++) changed = lmoc_turn(e, x);
  if (changed) return 0;
  for (int64_t k = 0; k < e->zeros; k++) largest = fmax(largest, fabs(e->zero[k]));
  for (int64_t i = 0; i < count; i++) {
    const int64_t r = e->of_zero[zeros[i]];
    const double value = e->zero[zeros[i]];
    if ((lmoc_decide(e->op[r], value) != 0) != (e->v[e->target[r]] > 0) &&
        !(fabs(value) <= fmax(e->margin[zeros[i]], EQUAL * largest))) return 0;
  }
  return 1;
}

/* Try values of relations, those with the fewest changes first. */
static int try_some(lmoc_instant *e, const double *x, const int64_t *zeros, int64_t count, int64_t most) {
  int64_t chosen[MOST_AT_ONCE];
  int trials = 0, found = 0;
  memset(e->supposed, 0, e->relations * sizeof(double));
  for (int64_t i = 0; i < count; i++) e->supposed[e->of_zero[zeros[i]]] = 1;
  e->supposing = 1;
  for (int64_t size = 0; size <= most && size <= count && size <= MOST_AT_ONCE && !found; size++) {
    for (int64_t i = 0; i < size; i++) chosen[i] = i;
    for (int more = 1; more && trials < TRIALS && !found; trials++) {
      for (int64_t i = 0; i < e->discrete; i++) e->v[e->own[i]] = e->history[LMOC_BEGUN*e->discrete + i];
      for (int64_t i = 0; i < size; i++) {
        double *own = e->v + e->target[e->of_zero[zeros[chosen[i]]]];
        *own = 1 - *own;
      }
      found = agrees(e, x, zeros, count);
      int64_t last = size - 1;  /* the next combination */
      while (last >= 0 && chosen[last] == count - size + last) last--;
      more = last >= 0;
      if (more) chosen[last]++;
      for (int64_t i = last + 1; more && i < size; i++) chosen[i] = chosen[i - 1] + 1;
    }
  }
  e->supposing = 0;
  return found;
}

/* Where the values repeat each other, those of the relations that flip are tried; then a few of all those in the
   equations of what has changed. */
static int try_relations(lmoc_instant *e, double t, const double *x) {
  fmu *f = e->owner;
  const fmu_events *m = &f->model->events;
  double *flipped = f->flags, *read = flipped + m->size;
  int64_t *zeros = f->chosen, count = 0;
  (void)t;
  memset(flipped, 0, 2 * m->size * sizeof(double));
  for (int64_t i = 0; i < e->discrete; i++) flipped[e->own[i]] = e->flipped[i];
  for (int64_t k = 0; k < e->zeros; k++)
    if (!lmoc_rounded(e, k) && flipped[e->target[e->of_zero[k]]] != 0) zeros[count++] = k;
  if (try_some(e, x, zeros, count, count)) return LMOC_SETTLED;
  for (int64_t i = 0; i < m->assigned; i++)
    if (flipped[m->assigned_ones[i]] != 0)
      for (int64_t j = m->first_read[i]; j < m->first_read[i + 1]; j++) read[m->read[j]] = 1;
  count = 0;
  for (int64_t k = 0; k < e->zeros; k++)
    if (!lmoc_rounded(e, k) && read[e->target[e->of_zero[k]]] != 0) zeros[count++] = k;
  return try_some(e, x, zeros, count, FEW) ? LMOC_SETTLED : LMOC_UNSETTLED;
}

void fmu_ask(fmu *f) {
  f->e.owner = f;
  f->e.look = look;
  f->e.widen = widen;
  f->e.others = try_relations;
  f->e.move = fmu_move;
}
