/* The quantities of laws by programs (`free_dynamics.h`). */

#include "free_dynamics.h"

enum { GAP, RATE, LEVEL, SLIP, STICK, FORCE };

static double not_negative(double limit) { return limit < 0 ? 0 : limit; }

/* The size of the terms whose sum a gap or rate is. */
static double scale_of(int64_t states, const double *slope, const double *x, double value) {
  double terms = 0, sum = 0;
  for (int64_t j = 0; j < states; j++) {
    terms += fabs(slope[j]) * fabs(x[j]);
    sum += slope[j] * x[j];
  }
  return terms + fabs(value - sum);
}

static void put(const lmoc_free_dynamics *f, const lmoc_settled *mode) {
  for (int64_t i = 0; i < 3 * f->laws; i++)
    if (f->inputs[i] >= 0) f->w[LMOC_BY_FORCE][f->inputs[i]] = mode ? lmoc_mode_input(mode, f->laws, i) : 0;
}

int lmoc_free_at(void *own, double time, const double *x, const lmoc_settled *mode, double *values) {
  lmoc_free_dynamics *f = own;
  const int64_t n = f->laws, m = f->states;
  double *delassus = values + 8*n, *slope = delassus + (n + m) * n;
  double *matrix[2] = {delassus, slope};
  double *quantity[] = {values, values + n, values + 4*n, values + 5*n, values + 6*n, values + 7*n};
  f->lost = 0;
  memset(delassus, 0, (size_t)((n + m) * n + 2*n*m) * sizeof(double));
  if (mode) put(f, mode);
  for (int k = 0; k < 2; k++) {
    double *w = f->w[k];
    for (int64_t j = 0; j < m; j++) w[f->state[j]] = x[j];
    f->lost |= f->tape[k]->run(time, w, f->tape[k]) & LMOC_FAILED;
    for (int64_t i = 0; i < f->count[k]; i++) matrix[k][f->entry[k][i]] = w[f->place[k][i]];
  }
  for (int64_t i = 0; i < 6*n; i++) {
    const int32_t at = f->quantity[i];
    const double value = at < 0 ? f->known[i] : f->w[LMOC_BY_FORCE][at];
    const int which = (int)(i / n);
    quantity[which][i % n] = which == SLIP || which == STICK ? not_negative(value) : value;
    if (which <= RATE) values[2*n + i] = at < 0 ? 0 : scale_of(m, slope + i*m, x, value);
  }
  if (mode) put(f, 0);
  slope[2*n*m] = f->stored < 0 ? NAN : f->w[LMOC_BY_FORCE][f->stored];
  return LMOC_SOLVED;
}
