/* Steps along Taylor series: their length, their ends, output within them, many at a time. */

#include "taylor.h"

#include "rows.h"

#include <float.h>

#define N_SERIES LMOC_LENGTH
#define LOOKS 4    /* places at which coordinates are looked at in a step (`steps/taylor.py`) */
#define JUDGED 50  /* steps from which their mean length is looked at (`steps/taylor.py`) */
#define LAST 5     /* terms that are looked at */
#define BESIDE 4   /* states that are worked on at once */
#define ALLOWED 5  /* tolerances that the slope may miss at the end of a step, as an error over the step */
#define BIT(lane) ((int64_t)1 << (lane))
#define Q(q, i, k) (q)[LMOC_AT((i)*N_SERIES + (k)) + l]
#define ROW(q, first, k) LMOC_ROW(q, (first) + (k))

static int evaluate(lmoc_call *c, lmoc_times time, const double *x) {
#if !LMOC_OF_LANES
  return lmoc_evaluate(c, time, x);
#else
  if (c->first_state >= 0) memcpy(c->w + LMOC_AT(c->first_state), x, LMOC_AT(c->n) * sizeof(double));
  else for (int64_t i = 0; i < c->n; i++) LMOC_ROW(c->w, c->states[i]) = LMOC_ROW(x, i);
  return c->tape->run(time, c->w, c->tape);
#endif
}

/* The coefficients of order k + 1 of the states, which those of order k of their derivatives give, into `q` too; what
   becomes of them times zero is added to `check`. */
LMOC_WIDEST static void raise(const lmoc_taylor *y, int64_t k, double *q, double *check) {
  const lmoc_series *r = y->series;
  const int64_t n = y->call->n;
  const double by = (double)(k + 1);
  lmoc_real sum = LMOC_ROW(check, 0);
  for (int64_t i = 0; i < n; i++) {
    const lmoc_real next = ROW(r->s, r->derivatives[i]*(int64_t)N_SERIES, k) / by;
    ROW(r->s, r->states[i]*(int64_t)N_SERIES, k + 1) = ROW(q, i*N_SERIES, k + 1) = next;
    sum += next * 0;
  }
  LMOC_ROW(check, 0) = sum;
}

int LMOC_NAME(lmoc_taylor_series)(const lmoc_taylor *y, lmoc_times time, const double *x, double *q) {
  double check[LMOC_LANES] = {0};
  int lost = evaluate(y->call, time, x);
  if ((lost & (BIT(LMOC_LANES) - 1)) == BIT(LMOC_LANES) - 1) return lost;
  lost |= LMOC_NAME(lmoc_series_begin)(y->series, time);
#if !LMOC_OF_LANES
  if (y->call->tables) lmoc_tables_series(y->call->tables, time, y->series->of_register, N_SERIES, y->series->s);
#endif
  for (int64_t i = 0; i < y->call->n; i++)
    ROW(q, i*N_SERIES, 0) = ROW(y->series->s, y->series->states[i]*(int64_t)N_SERIES, 0);
  for (int64_t k = 0; k < y->order; k++) {
    if (k) y->series->order(y->series, k);
    raise(y, k, q, check);
  }
  LMOC_EACH_LANE if (check[l] != 0) lost |= BIT(l);
  return lost;
}

/* Polynomials of some states at a distance from where a series begins, or their slopes: sums that do not wait for each
   other. */
LMOC_INLINE void polynomials(int64_t states, int slopes, int64_t order, const double *h, const double *q, lmoc_real *s) {
  const lmoc_real at = LMOC_ROW(h, 0);
  for (int64_t j = 0; j < states; j++) s[j] = (lmoc_real){0};
  for (int64_t k = order; k >= slopes; k--)
    for (int64_t j = 0; j < states; j++) {
      const lmoc_real own = ROW(q, j*N_SERIES, k);
      if (slopes) s[j] = s[j]*at + (double)k * own;
      else s[j] = s[j]*at + own;
    }
}

/* The states at a distance from where a series begins. */
LMOC_WIDEST static void value(int64_t n, int64_t order, const double *h, const double *q, double *x) {
  int64_t i = 0;
  for (; i + BESIDE <= n; i += BESIDE)
    polynomials(BESIDE, 0, order, h, q + LMOC_AT(i*N_SERIES), (lmoc_real *)(x + LMOC_AT(i)));
  for (; i < n; i++) polynomials(1, 0, order, h, q + LMOC_AT(i*N_SERIES), (lmoc_real *)(x + LMOC_AT(i)));
}

/* The same for some of the states at several distances of one lane; sums that do not wait for each other. */
LMOC_INLINE void some_values(int64_t n, int64_t order, int64_t count, const double *h, const double *q, int64_t states,
                             double *x) {
  lmoc_together s[8], distance[2];
  double *at = (double *)distance;
  for (int64_t j = 0; j < 2*LMOC_TOGETHER; j++) at[j] = h[j < count ? j : 0];
  for (int64_t j = 0; j < 2*states; j++) s[j] = (lmoc_together){0};
  for (int64_t k = order; k >= 0; k--)
    for (int64_t i = 0; i < states; i++) {
      const double own = q[LMOC_AT(i*N_SERIES + k)];
      s[2*i] = s[2*i]*distance[0] + own;
      s[2*i + 1] = s[2*i + 1]*distance[1] + own;
    }
  for (int64_t j = 0; j < count; j++)
    for (int64_t i = 0; i < states; i++) x[j*n + i] = ((double *)(s + 2*i))[j];
}

LMOC_WIDEST static void values(int64_t n, int64_t order, int64_t count, const double *h, const double *q, double *x) {
  for (; count > 0; count -= 2*LMOC_TOGETHER, h += 2*LMOC_TOGETHER, x += 2*LMOC_TOGETHER*n) {
    const int64_t m = count < 2*LMOC_TOGETHER ? count : 2*LMOC_TOGETHER;
    int64_t i = 0;
    for (; i + 4 <= n; i += 4) some_values(n, order, m, h, q + LMOC_AT(i*N_SERIES), 4, x + i);
    if (i + 2 <= n) {
      some_values(n, order, m, h, q + LMOC_AT(i*N_SERIES), 2, x + i);
      i += 2;
    }
    if (i < n) some_values(n, order, m, h, q + LMOC_AT(i*N_SERIES), 1, x + i);
  }
}

/* A step after which the last term is as large as the tolerances. Terms shrink by a factor an order: those before
   may be larger; five are looked at, because some vanish by symmetry. All in powers of two, of which some digits suffice: by
   the library's functions they took as long as the steps of a small scene. */
LMOC_WIDEST static void length(int64_t n, int64_t order, const double *rtol, const double *atol, const double *q,
                               double *h) {
  lmoc_real whole = (lmoc_real){0} + 1, sizes[LAST], power = (lmoc_real){0} + INFINITY;
  for (int64_t j = 0; j < LAST; j++) sizes[j] = (lmoc_real){0};
  for (int64_t i = 0; i < n; i++, q += LMOC_AT(N_SERIES)) {
    const lmoc_real y = lmoc_absolute(LMOC_ROW(q, 0)), by = 1 / (LMOC_ROW(atol, i) + LMOC_ROW(rtol, 0)*y);
    whole = lmoc_larger(whole, y*by);
    for (int64_t j = 0; j < LAST; j++)
      sizes[j] = lmoc_larger(sizes[j], lmoc_absolute(LMOC_ROW(q, order - j))*by);
  }
  const lmoc_real lost = lmoc_log2(whole) / (double)order;
  for (int64_t j = 0; j < LAST; j++) {
    const lmoc_real own = ((double)j*lost - lmoc_log2(sizes[j])) / (double)(order - j);
    power = lmoc_smaller(power, LMOC_CHOOSE(sizes[j] > DBL_MAX, (lmoc_real){0} - INFINITY, own));
  }
  LMOC_ROW(h, 0) = lmoc_exp2(power);
}

/* How much the polynomial misses the differential equation at its end, as an error of the step in tolerances: its
   derivative at h against that of the series that begins there. */
LMOC_WIDEST static void defect(int64_t n, int64_t order, const double *h, const double *rtol, const double *atol,
                               const double *q, const double *next, double *worst) {
  lmoc_real slopes[BESIDE], found = {0};
  for (int64_t i = 0; i < n; i++) {
    if (i % BESIDE == 0) {
      if (i + BESIDE <= n) polynomials(BESIDE, 1, order, h, q + LMOC_AT(i*N_SERIES), slopes);
      else for (int64_t j = i; j < n; j++) polynomials(1, 1, order, h, q + LMOC_AT(j*N_SERIES), slopes + j - i);
    }
    const lmoc_real y = lmoc_larger(lmoc_absolute(ROW(q, i*N_SERIES, 0)), lmoc_absolute(ROW(next, i*N_SERIES, 0)));
    const lmoc_real missed = LMOC_ROW(h, 0) * (slopes[i % BESIDE] - ROW(next, i*N_SERIES, 1));
    found = lmoc_worse(found, lmoc_absolute(missed) / (LMOC_ROW(atol, i) + LMOC_ROW(rtol, 0)*y));
  }
  LMOC_ROW(worst, 0) = found;
}

#if !LMOC_OF_LANES

/* Whether the way along the series is certainly good, looked at as closely as it takes. */
static int keeps(const lmoc_taylor *y, const lmoc_walk *s, double h, double reached, const double *x) {
  const lmoc_step_hook *hook = s->hook;
  const int64_t least = hook->land ? 1 : LOOKS;
  for (int64_t pieces = least; pieces <= (hook->pieces < least ? least : hook->pieces); pieces *= 2) {
    int lost = 0;
    for (int64_t i = 1; i < pieces && !lost; i++) {
      const double part = h * (double)i / (double)pieces;
      value(y->call->n, y->order, &part, s->next, s->between);
      lost = hook->look(hook->own, s->time[0] + part, s->between, i == 1);
    }
    if (!lost && !hook->look(hook->own, reached, x, pieces == 1)) return 1;
  }
  return 0;
}

/* Whether those who look at the end of a step have doubts. */
static int doubtful(const lmoc_taylor *y, const lmoc_walk *s, double h, double reached) {
  if (!s->hook) return 0;
  if (s->hook->land && s->hook->land(s->hook->own, reached, s->x)) return 1;
  return !keeps(y, s, h, reached, s->x);
}

/* The states at several distances from where a series begins. */
void lmoc_taylor_values(int64_t n, int64_t order, int64_t count, const double *h, const double *q, double *x) {
  values(n, order, count, h, q, x);
}

#endif

/* The states at the output times that the last step has reached. Returns whether there was room for them. */
static int output(const lmoc_taylor *y, lmoc_walk *s, int64_t l) {
  const int64_t n = y->call->n;
  double h[16*LMOC_TOGETHER];
  for (;;) {
    int64_t count = 0, at = s->reached[l];
    for (; count < 16*LMOC_TOGETHER && at < s->outputs[l] && s->times[l][at] <= s->time[l]; count++, at++) {
      if (at == s->room[l]) break;
      h[count] = s->times[l][at] - s->before[l];
    }
    values(n, y->order, count, h, s->q + l, s->out[l] + s->reached[l]*n);
    s->reached[l] = at;
    if (at >= s->outputs[l] || s->times[l][at] > s->time[l]) return 1;
    if (at == s->room[l]) return 0;
  }
}

/* Choose the steps of lanes that have none. */
static void choose(const lmoc_taylor *y, lmoc_walk *s, int64_t going) {
  double h[LMOC_LANES];
  int64_t open = 0;
  LMOC_EACH_LANE if (going & BIT(l) && s->ahead[l] == 0 && !s->begins[l]) open |= BIT(l);
  if (!open) return;
  length(y->call->n, y->order, s->rtol, s->atol, s->next, h);
  LMOC_EACH_LANE if (open & BIT(l)) s->ahead[l] = fmin(fmin(0.9*h[l], s->longest), s->end - s->time[l]);
}

static int64_t stopped_with(lmoc_walk *s, int64_t lane, int64_t found) {
  s->found[lane] = found;
  s->ahead[lane] = 0;
  return BIT(lane);
}

/* The last and the next series of some lanes change places. */
static void swap(int64_t n, lmoc_walk *s, int64_t taken, int64_t going) {
  double *const q = s->q, *const next = s->next;
  if (taken == going) {
    s->next = q;
    s->q = next;
    return;
  }
  LMOC_EACH_LANE
    for (int64_t j = 0; taken & BIT(l) && j < n*N_SERIES; j++) {
      const double last = next[LMOC_AT(j) + l];
      next[LMOC_AT(j) + l] = q[LMOC_AT(j) + l];
      q[LMOC_AT(j) + l] = last;
    }
}

/* What becomes of the step that a lane has tried: it is taken, or a shorter one is to be. */
static int is_taken(lmoc_walk *s, int64_t l, double reached, int lost, double missed, int64_t *stopped) {
  if (s->begins[l]) {
    s->begins[l] = 0;
    if (lost) *stopped |= stopped_with(s, l, LMOC_LOST);
    return !lost;
  }
  if (!lost && missed <= ALLOWED) {
    s->before[l] = s->time[l];
    s->time[l] = reached;
    s->ahead[l] = 0;
    s->tries[l]++;
    s->steps[l]++;
    return 1;
  }
  s->ahead[l] *= lost ? 0.25 : 0.6;
  if (lost && s->ahead[l] <= 1e-14 * fabs(s->time[l])) *stopped |= stopped_with(s, l, LMOC_LOST);
  else s->tries[l]++;
  return 0;
}

/* Whether the steps of a lane are shorter in the mean than they have to be. */
static int crawls(const lmoc_walk *s, int64_t l) {
  const int64_t steps = s->made[l] + s->steps[l];
  return s->shortest[l] > 0 && steps >= JUDGED && s->time[l] - s->begun[l] < (double)steps * s->shortest[l];
}

/* Try a step along `next` in all lanes that are going: the series that begins at its end into `q`. Returns those that
   have stopped: SHORT where no step is short enough, LOST where there is no value beyond, DOUBTFUL where the closures have
   to be looked at more closely. */
static int64_t advance(const lmoc_taylor *y, lmoc_walk *s, int64_t going) {
  const int64_t n = y->call->n;
  double h[LMOC_LANES], reached[LMOC_LANES], missed[LMOC_LANES];
  int64_t stopped = 0, taken = 0, steps[LMOC_LANES];
  choose(y, s, going);
  LMOC_EACH_LANE {
    steps[l] = s->steps[l];
    h[l] = s->ahead[l];
    reached[l] = s->time[l] + h[l];
    if (!(going & BIT(l)) || s->begins[l]) continue;
    if (s->time[l] + 1.001*h[l] >= s->end) { reached[l] = s->end; h[l] = s->ahead[l] = s->end - s->time[l]; }
    s->length[l] = h[l];
    if (h[l] <= 8e-16 * fabs(reached[l]) || h[l] < 1e-300) stopped |= stopped_with(s, l, LMOC_SHORT);
  }
  if (stopped == going) return stopped;
  value(n, y->order, h, s->next, s->x);
  LMOC_EACH_LANE
    for (int64_t i = 0; s->begins[l] && i < n; i++) s->x[LMOC_AT(i) + l] = Q(s->next, i, 0);
#if !LMOC_OF_LANES
  if (doubtful(y, s, h[0], reached[0])) return stopped_with(s, 0, LMOC_DOUBTFUL);
  const int lost = lmoc_taylor_series(y, reached[0], s->x, s->q);
#else
  const int lost = LMOC_NAME(lmoc_taylor_series)(y, reached, s->x, s->q);
#endif
  defect(n, y->order, h, s->rtol, s->atol, s->next, s->q, missed);
  LMOC_EACH_LANE
    if (going & ~stopped & BIT(l) && is_taken(s, l, reached[l], (lost >> l) & 1, missed[l], &stopped)) taken |= BIT(l);
  swap(n, s, taken, going);
  LMOC_EACH_LANE
    if (s->steps[l] > steps[l]) {
      lmoc_mark(y->call);
      if (s->hook) s->hook->keep(s->hook->own);
      if (crawls(s, l)) stopped |= stopped_with(s, l, LMOC_STIFF);
      else if (!output(y, s, l) || s->steps[l] >= s->most[l] || s->time[l] >= s->end) stopped |= stopped_with(s, l, 0);
    }
  return stopped;
}

int64_t LMOC_NAME(lmoc_taylor_go)(const lmoc_taylor *y, lmoc_walk *s) {
  int64_t going = 0, stopped = 0;
  LMOC_EACH_LANE if (s->most[l] > 0 && s->time[l] < s->end) going |= BIT(l);
  while (going && !stopped) stopped = advance(y, s, going);
  for (int64_t i = 0; i < y->call->n; i++) LMOC_ROW(s->x, i) = ROW(s->next, i*N_SERIES, 0);
  return stopped;
}

#if !LMOC_OF_LANES

int lmoc_taylor_walk(const lmoc_taylor *y, lmoc_walk *s) {
  lmoc_walk_afresh(s, 0);
  lmoc_taylor_go(y, s);
  return (int)s->found[0];
}

#endif
