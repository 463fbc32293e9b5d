/* Steps along Taylor series: their length, their ends, output within them, many at a time. */

#include "taylor.h"

#define N_SERIES LMOC_LENGTH
#define LOOKS 4    /* places at which coordinates are looked at in a step (`steps/taylor.py`) */
#define ALLOWED 5  /* tolerances that the slope may miss at the end of a step, as an error over the step */

/* Coefficients 0 … order of the states at (time, x) into q, (n, N_SERIES). */
int lmoc_taylor_series(const lmoc_taylor *y, double time, const double *x, double *q) {
  lmoc_call *c = y->call;
  const lmoc_series *r = y->series;
  double *s = r->s, check = 0;
  if (lmoc_evaluate(c, time, x)) return 1;
  if (lmoc_series_begin(r, time)) return 1;
  for (int64_t k = 0; k < y->order; k++) {
    if (k) lmoc_series_order(r, k);
    for (int64_t i = 0; i < c->n; i++) {
      const double next = s[r->derivatives[i]*(int64_t)N_SERIES + k] / (double)(k + 1);
      s[r->states[i]*(int64_t)N_SERIES + k + 1] = next;
      check += next * 0;
    }
  }
  for (int64_t i = 0; i < c->n; i++) memcpy(q + i*N_SERIES, s + r->states[i]*(int64_t)N_SERIES, N_SERIES * sizeof(double));
  return check != 0;
}

static void value(int64_t n, int64_t order, double h, const double *q, double *x) {
  for (int64_t i = 0; i < n; i++) {
    double s = 0;
    for (int64_t k = order; k >= 0; k--) s = s*h + q[i*N_SERIES + k];
    x[i] = s;
  }
}

/* A step after which the last term is as large as the tolerances. Terms shrink by a factor an order: those before
   may be larger; five are looked at, because some vanish by symmetry. */
static double length(int64_t n, int64_t order, double rtol, const double *atol, const double *q) {
  double h = INFINITY, whole = 1;
  for (int64_t i = 0; i < n; i++)
    whole = fmax(whole, fabs(q[i*N_SERIES]) / (atol[i] + rtol*fabs(q[i*N_SERIES])));
  const double factor = pow(whole, -1.0 / (double)order);
  for (int64_t k = order; k > order - 5 && k > 0; k--) {
    double size = 0;
    for (int64_t i = 0; i < n; i++)
      size = lmoc_max(size, fabs(q[i*N_SERIES + k]) / (atol[i] + rtol*fabs(q[i*N_SERIES])));
    if (size > 0) h = fmin(h, pow(size * pow(factor, (double)(order - k)), -1.0 / (double)k));
  }
  return h;
}

/* How much the polynomial misses the differential equation at its end, as an error of the step in tolerances: its
   derivative at h against that of the series that begins there. */
static double defect(int64_t n, int64_t order, double h, double rtol, const double *atol, const double *q,
                                 const double *next) {
  double worst = 0;
  for (int64_t i = 0; i < n; i++) {
    double s = 0;
    for (int64_t k = order; k > 0; k--) s = s*h + (double)k * q[i*N_SERIES + k];
    const double scale = atol[i] + rtol*fmax(fabs(q[i*N_SERIES]), fabs(next[i*N_SERIES]));
    worst = lmoc_max(worst, fabs(h * (s - next[i*N_SERIES + 1])) / scale);
  }
  return worst;
}

/* Whether the way along the series is certainly good, looked at as closely as it takes. */
static int keeps(const lmoc_taylor *y, const lmoc_walk *s, double h, double reached, const double *x) {
  const lmoc_step_hook *hook = s->hook;
  const int64_t least = hook->land ? 1 : LOOKS;
  for (int64_t pieces = least; pieces <= (hook->pieces < least ? least : hook->pieces); pieces *= 2) {
    int lost = 0;
    for (int64_t i = 1; i < pieces && !lost; i++) {
      const double part = h * (double)i / (double)pieces;
      value(y->call->n, y->order, part, s->next, s->between);
      lost = hook->look(hook->own, s->time + part, s->between, i == 1);
    }
    if (!lost && !hook->look(hook->own, reached, x, pieces == 1)) return 1;
  }
  return 0;
}

/* One step along `next`; the series that begins at its end into `q`. Returns 0; SHORT where no step is short enough,
   LOST where there is no value beyond, DOUBTFUL where the closures have to be looked at more closely. */
static int step(const lmoc_taylor *y, lmoc_walk *s) {
  const int64_t n = y->call->n;
  double h = fmin(fmin(0.9 * length(n, y->order, s->rtol, s->atol, s->next), s->longest), s->end - s->time);
  for (;; s->tries++) {
    double reached = s->time + h;
    if (s->time + 1.001*h >= s->end) { reached = s->end; h = s->end - s->time; }
    s->length = h;
    if (h <= 8e-16 * fabs(reached) || h < 1e-300) return LMOC_SHORT;
    value(n, y->order, h, s->next, s->x);
    if (s->hook && s->hook->land && s->hook->land(s->hook->own, reached, s->x)) return LMOC_DOUBTFUL;
    if (s->hook && !keeps(y, s, h, reached, s->x)) return LMOC_DOUBTFUL;
    const int lost = lmoc_taylor_series(y, reached, s->x, s->q);
    if (!lost && defect(n, y->order, h, s->rtol, s->atol, s->next, s->q) <= ALLOWED) {
      double *last = s->next;
      s->next = s->q;
      s->q = last;
      s->before = s->time;
      s->time = reached;
      s->tries++;
      return 0;
    }
    h *= lost ? 0.25 : 0.6;
    if (lost && h <= 1e-14 * fabs(s->time)) return LMOC_LOST;
  }
}

/* The states at several distances from where a series begins. */
void lmoc_taylor_values(int64_t n, int64_t order, int64_t count, const double *h, const double *q, double *x) {
  for (int64_t k = 0; k < count; k++) value(n, order, h[k], q, x + k*n);
}

/* The states at the output times that the last step has reached. Returns whether there was room for them. */
static int output(const lmoc_taylor *y, lmoc_walk *s) {
  const int64_t n = y->call->n;
  for (; s->reached < s->outputs && s->times[s->reached] <= s->time; s->reached++) {
    if (s->reached == s->room) return 0;
    value(n, y->order, s->times[s->reached] - s->before, s->q, s->out + s->reached*n);
  }
  return 1;
}

/* Steps with their output: as many as allowed, until the end or until there is no room for output within the last one.
   Returns what that has; `x` is the state at `time`. */
int lmoc_taylor_walk(const lmoc_taylor *y, lmoc_walk *s) {
  const int64_t n = y->call->n;
  int found = 0;
  s->steps = s->tries = s->reached = 0;
  while (!found && s->steps < s->most && s->time < s->end) {
    found = step(y, s);
    if (found) break;
    lmoc_mark(y->call);
    if (s->hook) s->hook->keep(s->hook->own);
    s->steps++;
    if (!output(y, s)) break;
  }
  for (int64_t i = 0; i < n; i++) s->x[i] = s->next[i*N_SERIES];
  return found;
}
