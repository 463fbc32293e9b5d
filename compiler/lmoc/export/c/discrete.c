/* What `engine/c/instant.c` asks an FMU: values at a place, on the tapes of `export/instants.py`. */

#include "discrete.h"

static const double ULP = 0x1p-52, ZERO = 1e-10, NOISES = 32;

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

void fmu_ask(fmu *f) {
  f->e.owner = f;
  f->e.look = look;
  f->e.widen = widen;
  f->e.others = lmoc_try_relations;
  f->e.move = fmu_move;
}
