/* The way back onto closures, and whether they keep their rank from one place to the next (`formulations/landing.py`). */

#include "landing.h"

#define CORRECTIONS 10
#define SMALL 1e-9    /* of the size of a coordinate: a correction behind which nothing is left to correct */
#define SHORT_WAY 1e-2  /* of the size of a coordinate: the longest way back onto the closures */

/* The entries and residuals of a stage at a place; 0 where they are numbers. */
static int closing_at(const lmoc_closures *c, int64_t k, double time, const double *x) {
  const lmoc_closure_stage *s = c->stage + k;
  for (int64_t i = 0; i < c->n; i++) s->w[c->states[i]] = x[i];
  double check = s->tape->run(time, s->w, s->tape) ? NAN : 0;
  for (int64_t i = 0; i < s->entries + s->residuals; i++) {
    s->out[i] = s->w[s->results[i]];
    check += s->out[i] * 0;
  }
  return check != 0;
}

static void fill(const lmoc_closures *c, const lmoc_loops *g, const double *out, double *a) {
  memset(a, 0, g->loops*g->m*g->n * sizeof(double));
  for (int64_t e = 0; e < g->entries; e++) a[g->place[e]] = out[g->source[e]];
  for (int64_t l = 0; l < g->loops; l++)
    for (int64_t i = 0; i < g->m; i++)
      for (int64_t j = 0; j < g->n; j++) a[(l*g->m + i)*g->n + j] *= c->scale[g->columns[l*g->n + j]];
}

int64_t lmoc_closure_count(const lmoc_closures *c) {
  int64_t count = 0;
  for (int64_t k = 0; k < c->stages; k++) count += c->stage[k].residuals;
  return count;
}

int lmoc_closure_rows(const lmoc_closures *c, double time, const double *x, double *value, double *slope) {
  memset(slope, 0, lmoc_closure_count(c) * c->n * sizeof(double));
  for (int64_t k = 0; k < c->stages; k++) {
    const lmoc_closure_stage *s = c->stage + k;
    if (closing_at(c, k, time, x)) return 1;
    for (const lmoc_loops *g = s->group; g < s->group + s->groups; g++)
      for (int64_t e = 0; e < g->entries; e++) {
        const int64_t row = g->place[e] / g->n, loop = row / g->m;
        slope[g->rows[row] * c->n + g->columns[loop * g->n + g->place[e] % g->n]] = s->out[g->source[e]];
      }
    memcpy(value, s->out + s->entries, s->residuals * sizeof(double));
    value += s->residuals;
    slope += s->residuals * c->n;
  }
  return 0;
}

/* L with L L^T = B B^T for B (m, n), rows divided by `size`; 0 where there is none. */
static int cholesky(int64_t m, int64_t n, const double *b, const double *size, double *l) {
  for (int64_t i = 0; i < m; i++)
    for (int64_t j = 0; j <= i; j++) {
      double s = 0;
      for (int64_t k = 0; k < n; k++) s += b[i*n + k] * b[j*n + k];
      s /= size[i] * size[j];
      for (int64_t k = 0; k < j; k++) s -= l[i*m + k] * l[j*m + k];
      if (i > j) l[i*m + j] = s / l[j*m + j];
      else if (!(s > 0)) return 0;
      else l[i*m + i] = sqrt(s);
    }
  return 1;
}

/* A lower bound of the smallest singular value: 1/|L^-1| in Frobenius' norm. `x` has room for m numbers. */
static double margin_of(int64_t m, const double *l, double *x) {
  double sum = 0;
  for (int64_t k = 0; k < m; k++)
    for (int64_t i = k; i < m; i++) {
      double s = i == k;
      for (int64_t j = k; j < i; j++) s -= l[i*m + j] * x[j];
      x[i] = s / l[i*m + i];
      sum += x[i] * x[i];
    }
  return 1 / sqrt(sum);
}

/* Whether det(A B^T) > 0 for rows divided by `size`, by elimination. */
static int same_side(int64_t m, int64_t n, const double *a, const double *b, const double *size, double *p) {
  int sign = 1;
  for (int64_t i = 0; i < m; i++)
    for (int64_t j = 0; j < m; j++) {
      double s = 0;
      for (int64_t k = 0; k < n; k++) s += a[i*n + k] * b[j*n + k];
      p[i*m + j] = s / (size[i] * size[j]);
    }
  for (int64_t k = 0; k < m; k++) {
    int64_t pivot = k;
    for (int64_t i = k + 1; i < m; i++) if (fabs(p[i*m + k]) > fabs(p[pivot*m + k])) pivot = i;
    if (pivot != k) {
      sign = -sign;
      for (int64_t j = k; j < m; j++) { const double t = p[k*m + j]; p[k*m + j] = p[pivot*m + j]; p[pivot*m + j] = t; }
    }
    const double own = p[k*m + k];
    if (!(fabs(own) > 0)) return 0;
    if (own < 0) sign = -sign;
    for (int64_t i = k + 1; i < m; i++) {
      const double f = p[i*m + k] / own;
      for (int64_t j = k + 1; j < m; j++) p[i*m + j] -= f * p[k*m + j];
    }
  }
  return sign > 0;
}

int lmoc_look(void *own, double time, const double *x, int first) {
  lmoc_closures *c = own;
  if (closing_at(c, 0, time, x)) return 1;
  const lmoc_closure_stage *s = c->stage;
  for (int64_t k = 0; k < s->groups; k++) {
    lmoc_loops *g = s->group + k;
    const int64_t m = g->m, n = g->n;
    fill(c, g, s->out, g->now);
    const double *from = first == 1 ? g->kept : g->last, *had = g->margins + (first == 1 ? 0 : g->loops);
    for (int64_t l = 0; l < g->loops; l++) {
      const double *a = g->now + l*m*n, *b = from + l*m*n;
      double *size = g->sizes + l*m, *work = g->work, shrunk = 1;
      for (int64_t i = 0; i < m; i++) {
        double length = 0;
        for (int64_t j = 0; j < n; j++) length += a[i*n + j] * a[i*n + j];
        length = sqrt(length);
        if (length > size[i]) { shrunk = fmin(shrunk, size[i] / length); size[i] = length; }
      }
      g->margins[l] *= shrunk;  /* rows that become longer make those before shorter beside them */
      g->margins[g->loops + l] *= shrunk;
      if (!cholesky(m, n, a, size, work)) return 1;
      const double margin = g->margins[2*g->loops + l] = margin_of(m, work, work + m*m);
      if (!(margin > c->firm)) return 1;
      if (first < 0) continue;
      double change = 0;
      for (int64_t i = 0; i < m; i++)
        for (int64_t j = 0; j < n; j++) {
          const double d = (a[i*n + j] - b[i*n + j]) / size[i];
          change += d*d;
        }
      const double both = margin + had[l];
      if (!(change < both*both) || !same_side(m, n, a, b, size, work)) return 1;
    }
  }
  for (int64_t k = 0; k < s->groups; k++) {
    lmoc_loops *g = s->group + k;
    double *t = g->last;
    g->last = g->now;
    g->now = t;
    memcpy(g->margins + g->loops, g->margins + 2*g->loops, g->loops * sizeof(double));
  }
  return 0;
}

void lmoc_keep(void *own) {
  lmoc_closures *c = own;
  for (int64_t k = 0; k < c->stage->groups; k++) {
    lmoc_loops *g = c->stage->group + k;
    memcpy(g->kept, g->last, g->loops*g->m*g->n * sizeof(double));
    memcpy(g->margins, g->margins + g->loops, g->loops * sizeof(double));
  }
  for (int k = 0; k < 2; k++) c->largest[k] = fmax(c->largest[k], c->found[k]);
}

/* One correction of Newton's method; the largest in sizes of the coordinates, no number where there is none. */
static double correct(const lmoc_closures *c, const lmoc_closure_stage *s, double *x) {
  double largest = 0;
  for (int64_t k = 0; k < s->groups; k++) {
    const lmoc_loops *g = s->group + k;
    const int64_t m = g->m, n = g->n;
    fill(c, g, s->out, g->now);
    for (int64_t l = 0; l < g->loops; l++) {
      const double *a = g->now + l*m*n;
      double *work = g->work, *y = work + m*m, *size = y + m;
      for (int64_t i = 0; i < m; i++) {
        double length = 0;
        for (int64_t j = 0; j < n; j++) length += a[i*n + j] * a[i*n + j];
        size[i] = sqrt(length);
        y[i] = s->out[s->entries + g->rows[l*m + i]] / size[i];
      }
      if (!cholesky(m, n, a, size, work)) return NAN;
      for (int64_t i = 0; i < m; i++) {
        for (int64_t j = 0; j < i; j++) y[i] -= work[i*m + j] * y[j];
        y[i] /= work[i*m + i];
      }
      for (int64_t i = m - 1; i >= 0; i--) {
        for (int64_t j = i + 1; j < m; j++) y[i] -= work[j*m + i] * y[j];
        y[i] /= work[i*m + i];
      }
      for (int64_t j = 0; j < n; j++) {
        const int32_t state = g->columns[l*n + j];
        if (c->scale[state] == 0) continue; /* is held */
        double move = 0;
        for (int64_t i = 0; i < m; i++) move += a[i*n + j] / size[i] * y[i];
        move *= c->scale[state];
        x[state] -= move;
        largest = lmoc_max(largest, fabs(move) / fmax(fabs(x[state]), c->scale[state]));
      }
    }
  }
  return largest;
}

static int land(lmoc_closures *c, int64_t first, double time, double *x) {
  for (int64_t k = first; k < c->stages; k++) {
    const lmoc_closure_stage *s = c->stage + k;
    double length = INFINITY;
    for (int i = 0; length > SMALL; i++) {
      if (i == CORRECTIONS || closing_at(c, k, time, x)) return 1;
      length = correct(c, s, x);
      if (!(length <= SHORT_WAY)) return 1;
    }
    if (closing_at(c, k, time, x)) return 1;
    c->found[k] = 0;
    for (int64_t i = 0; i < s->residuals; i++) c->found[k] = fmax(c->found[k], fabs(s->out[s->entries + i]));
  }
  return 0;
}

int lmoc_land(void *own, double time, double *x) { return land(own, 0, time, x); }

int lmoc_land_rates(lmoc_closures *c, double time, double *x) { return land(c, c->stages - 1, time, x); }

int lmoc_land_many(void *own, int64_t count, const double *times, double *x) {
  const lmoc_closures *c = own;
  for (int64_t i = 0; i < count; i++) if (lmoc_land(own, times[i], x + i*c->n)) return 1;
  return 0;
}
