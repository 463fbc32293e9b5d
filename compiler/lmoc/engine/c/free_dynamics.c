/* The quantities of laws by programs (`free_dynamics.h`). */

#include "free_dynamics.h"

enum { GAP, RATE, LEVEL, SLIP, STICK };

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

int lmoc_free_at(void *own, double time, const double *x, double *values) {
  lmoc_free_dynamics *f = own;
  const int64_t n = f->laws, m = f->states;
  double *delassus = values + 7*n, *slope = delassus + (n + m) * n;
  double *matrix[2] = {delassus, slope}, *quantity[] = {values, values + n, values + 4*n, values + 5*n, values + 6*n};
  f->lost = 0;
  memset(delassus, 0, (size_t)((n + m) * n + 2*n*m) * sizeof(double));
  for (int k = 0; k < 2; k++) {
    double *w = f->w[k];
    for (int64_t j = 0; j < m; j++) w[f->state[j]] = x[j];
    f->lost |= f->tape[k]->run(time, w, f->tape[k]) & LMOC_FAILED;
    for (int64_t i = 0; i < f->count[k]; i++) matrix[k][f->entry[k][i]] = w[f->place[k][i]];
  }
  for (int64_t i = 0; i < 5*n; i++) {
    const int32_t at = f->quantity[i];
    const double value = at < 0 ? f->known[i] : f->w[LMOC_BY_FORCE][at];
    const int which = (int)(i / n);
    quantity[which][i % n] = which < SLIP ? value : not_negative(value);
    if (which <= RATE) values[2*n + i] = at < 0 ? 0 : scale_of(m, slope + i*m, x, value);
  }
  slope[2*n*m] = f->stored < 0 ? NAN : f->w[LMOC_BY_FORCE][f->stored];
  return LMOC_SOLVED;
}
