/* Radau IIA (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 1996, IV.8): simplified Newton's method on
   transformed stages, one real and one complex system, here of twice the size in real numbers. */

#include "radau.h"
#include "dense.h"

#include <math.h>
#include <string.h>

#define S6 2.449489742783178
static const double NODES[] = {(4 - S6) / 10, (4 + S6) / 10, 1};
static const double ERROR[] = {(-13 - 7 * S6) / 3, (-13 + 7 * S6) / 3, -1.0 / 3};
static const double REAL = 3.6378342527444957, COMPLEX[] = {2.6810828736277523, -3.0504301992474105}; /* eigenvalues of the
                                                                          inverse of the method's matrix */
static const double BACK[3][3] = {{0.09443876248897524, -0.14125529502095421, 0.03002919410514742},
                                  {0.25021312296533332, 0.20412935229379994, -0.38294211275726192},
                                  {1, 1, 0}};
static const double TRANSFORM[3][3] = {{4.17871859155190428, 0.32768282076106237, 0.52337644549944951},
                                       {-4.17871859155190428, -0.32768282076106237, 0.47662355450055044},
                                       {0.50287263494578682, -2.57192694985560522, 0.59603920482822492}};
static const double DENSE[3][3] = {{13.0 / 3 + 7 * S6 / 3, -23.0 / 3 - 22 * S6 / 3, 10.0 / 3 + 5 * S6},
                                   {13.0 / 3 - 7 * S6 / 3, -23.0 / 3 + 22 * S6 / 3, 10.0 / 3 - 5 * S6},
                                   {1.0 / 3, -8.0 / 3, 10.0 / 3}};
static const double LEAST_FACTOR = 0.2, MOST_FACTOR = 10;
static const double ASIDE = 1.5e-8;      /* of a state, for differences */
static const double NO_STEP = 1e-15;     /* of the time */
static const double WORTHWHILE = 1.2;    /* below that factor the factorized matrix serves again */
static const double SLOWLY = 1e-3;       /* Newton's method; a new matrix is worth its while */
enum { MOST_ITERATIONS = 6 };

int64_t lmoc_radau_place(lmoc_radau *s, double *memory) {
  const int64_t n = s->n, own = s->factor ? 0 : n*n;
  int64_t total = 0;
#define TAKE(name, count) (s->name = memory ? (void *)(memory + total) : 0, total += (count))
  TAKE(x, n); TAKE(last, n); TAKE(f, n); TAKE(dense, 3*n); TAKE(jacobian, own); TAKE(real, own); TAKE(both, 4*own);
  TAKE(z, 3*n); TAKE(w, 3*n); TAKE(k, 3*n); TAKE(first, n); TAKE(second, 2*n); TAKE(scale, n); TAKE(next, n); TAKE(error, n);
  TAKE(pivots, 2*n);
#undef TAKE
  return total;
}

/* Row i of a 3 x 3 matrix times three vectors. */
static double row(const double m[3], const double *v, int64_t n, int64_t i) { return m[0]*v[i] + m[1]*v[n + i] + m[2]*v[2*n + i]; }

static double norm(const lmoc_radau *s, const double *v) {
  double sum = 0;
  for (int64_t i = 0; i < s->n; i++) sum += v[i] / s->scale[i] * (v[i] / s->scale[i]);
  return sqrt(sum / (double)s->n);
}

static void rates_at(lmoc_radau *s, double time, const double *x, double *out) {
  s->evaluations++;
  s->rates(s->owner, time, x, out);
}

static void differences(lmoc_radau *s) {
  const int64_t n = s->n;
  double *aside = s->next, *there = s->error;
  memcpy(aside, s->x, (size_t)n * sizeof(double));
  for (int64_t j = 0; j < n; j++) {
    aside[j] = s->x[j] + ASIDE * fmax(fabs(s->x[j]), s->atol[j] / s->rtol);
    rates_at(s, s->t, aside, there);
    for (int64_t i = 0; i < n; i++) s->jacobian[i*n + j] = (there[i] - s->f[i]) / (aside[j] - s->x[j]);
    aside[j] = s->x[j];
  }
  rates_at(s, s->t, s->x, there);
}

/* Take the Jacobian at the present place. */
static void renew(lmoc_radau *s) {
  if (s->slopes) s->slopes(s->owner, s->t, s->x, s->jacobian);
  else differences(s);
  s->mark(s->owner);
  s->jacobians++;
  s->factored = 0;
  s->fresh = 1;
}

void lmoc_radau_jump(lmoc_radau *s) {
  s->before = s->t;
  memcpy(s->last, s->x, (size_t)s->n * sizeof(double));
  s->dense[0] = NAN;
  s->earlier = 0;
  rates_at(s, s->t, s->x, s->f);
  renew(s);
}

static int factorized(lmoc_radau *s, double h) {
  const int64_t n = s->n;
  const double a = COMPLEX[0] / h, b = COMPLEX[1] / h;
  double determinant;
  if (s->factored == h) return 1;
  if (s->factor) {
    s->factored = s->factor(s->owner, h) ? h : 0;
    return s->factored == h;
  }
  memset(s->both, 0, (size_t)(4*n*n) * sizeof(double));
  for (int64_t i = 0; i < n; i++) {
    for (int64_t j = 0; j < n; j++) {
      s->real[i*n + j] = (i == j ? REAL / h : 0) - s->jacobian[i*n + j];
      s->both[2*n*i + j] = s->both[2*n*(i + n) + j + n] = (i == j ? a : 0) - s->jacobian[i*n + j];
    }
    s->both[2*n*i + i + n] = -b;
    s->both[2*n*(i + n) + i] = b;
  }
  const int regular = lmoc_dense_factor(n, s->real, s->pivots, &determinant) &&
                      lmoc_dense_factor(2*n, s->both, s->pivots + n, &determinant);
  s->factored = regular ? h : 0;
  return regular;
}

static void substitute(lmoc_radau *s, int complex, double *v) {
  if (s->factor) s->substitute(s->owner, complex, v);
  else if (complex) lmoc_dense_substitute(2*s->n, s->both, s->pivots + s->n, 1, v);
  else lmoc_dense_substitute(s->n, s->real, s->pivots, 1, v);
}

/* The derivatives at the stages; 0 where there are none. */
static int stage_rates(lmoc_radau *s, double h) {
  double check = 0;
  for (int64_t stage = 0; stage < 3; stage++) {
    for (int64_t i = 0; i < s->n; i++) s->next[i] = s->x[i] + s->z[stage * s->n + i];
    rates_at(s, s->t + h * NODES[stage], s->next, s->k + stage * s->n);
  }
  for (int64_t i = 0; i < 3 * s->n; i++) check += s->k[i] * 0;
  return check == 0;
}

/* One iteration; the length of the step that it makes. */
static double iterate(lmoc_radau *s, double h) {
  const int64_t n = s->n;
  double *w = s->w, sum = 0;
  for (int64_t i = 0; i < n; i++) {
    s->first[i] = row(TRANSFORM[0], s->k, n, i) - REAL / h * w[i];
    s->second[i] = row(TRANSFORM[1], s->k, n, i) - (COMPLEX[0] * w[n + i] - COMPLEX[1] * w[2*n + i]) / h;
    s->second[i + n] = row(TRANSFORM[2], s->k, n, i) - (COMPLEX[0] * w[2*n + i] + COMPLEX[1] * w[n + i]) / h;
  }
  substitute(s, 0, s->first);
  substitute(s, 1, s->second);
  for (int64_t i = 0; i < n; i++) {
    const double a = s->first[i], b = s->second[i], c = s->second[i + n];
    sum += (a*a + b*b + c*c) / (s->scale[i] * s->scale[i]);
    w[i] += a;
    w[n + i] += b;
    w[2*n + i] += c;
    for (int64_t stage = 0; stage < 3; stage++) s->z[stage*n + i] = row(BACK[stage], w, n, i);
  }
  return sqrt(sum / (3 * (double)n));
}

/* Simplified Newton's method: how many iterations, 0 where it does not converge, and its rate. */
static int stages(lmoc_radau *s, double h, double *rate) {
  const int64_t n = s->n;
  const double wanted = fmax(2.2e-15 / s->rtol, fmin(0.03, sqrt(s->rtol)));
  double before = 0;
  if (!factorized(s, h)) return 0;
  for (int64_t stage = 0; stage < 3; stage++) { /* what the polynomial of the last step gives */
    double *z = s->z + stage*n;
    if (s->dense[0] == s->dense[0]) lmoc_radau_within(s, s->t + h * NODES[stage], z);
    for (int64_t i = 0; i < n; i++) z[i] = s->dense[0] == s->dense[0] ? z[i] - s->x[i] : 0;
  }
  for (int64_t stage = 0; stage < 3; stage++)
    for (int64_t i = 0; i < n; i++) s->w[stage*n + i] = row(TRANSFORM[stage], s->z, n, i);
  *rate = 0;
  for (int k = 0; k < MOST_ITERATIONS; k++) {
    if (!stage_rates(s, h)) return 0;
    const double length = iterate(s, h);
    if (k) {
      *rate = length / before;
      if (*rate >= 1 || pow(*rate, MOST_ITERATIONS - k) / (1 - *rate) * length > wanted) return 0;
    }
    if (length == 0 || (k && *rate / (1 - *rate) * length < wanted)) return k + 1;
    before = length;
  }
  return 0;
}

/* The error of the step to `next`, with derivatives at its beginning. */
static double error_of(lmoc_radau *s, double h, const double *f) {
  for (int64_t i = 0; i < s->n; i++) s->error[i] = f[i] + row(ERROR, s->z, s->n, i) / h;
  substitute(s, 0, s->error);
  return norm(s, s->error);
}

/* The factor of the step size that the error asks for (Gustafsson's predictive controller). */
static double factor(const lmoc_radau *s, double h, double error) {
  if (error == 0) return MOST_FACTOR;
  const double more = s->earlier > 0 ? h / s->earlier * pow(s->earlier_error / error, 0.25) : 1;
  return fmin(1, more) * pow(error, -0.25);
}

static void accept(lmoc_radau *s, double h, double error, double safety, int slowly) {
  const int64_t n = s->n;
  const double grown = fmin(MOST_FACTOR, safety * factor(s, h, error));
  s->mark(s->owner);
  memcpy(s->last, s->x, (size_t)n * sizeof(double));
  memcpy(s->x, s->next, (size_t)n * sizeof(double));
  s->before = s->t;
  s->t = s->t + 1.001 * h >= s->end ? s->end : s->t + h;
  s->length = h;
  for (int64_t i = 0; i < n; i++)
    for (int k = 0; k < 3; k++)
      s->dense[k*n + i] = DENSE[0][k] * s->z[i] + DENSE[1][k] * s->z[n + i] + DENSE[2][k] * s->z[2*n + i];
  s->earlier = h;
  s->earlier_error = error;
  s->rejected_last = 0;
  rates_at(s, s->t, s->x, s->f);
  s->fresh = 0;
  if (slowly) renew(s);
  s->step_size = slowly || grown >= WORTHWHILE ? h * grown : h;
}

int lmoc_radau_step(lmoc_radau *s) {
  const int64_t n = s->n;
  double h = fmin(fmin(s->step_size, s->max_step), s->end - s->t), rate;
  if (s->t + 1.001 * h >= s->end) h = s->end - s->t;
  for (;;) {
    if (!(h > NO_STEP * fmax(fabs(s->t), 1e-300))) return 0;
    s->go_back(s->owner);
    for (int64_t i = 0; i < n; i++) s->scale[i] = s->atol[i] + s->rtol * fabs(s->x[i]);
    const int iterations = stages(s, h, &rate);
    if (!iterations) {
      s->rejected++;
      if (s->fresh) h /= 2;
      else renew(s);
      continue;
    }
    for (int64_t i = 0; i < n; i++) {
      s->next[i] = s->x[i] + s->z[2*n + i];
      s->scale[i] = s->atol[i] + s->rtol * fmax(fabs(s->next[i]), fabs(s->x[i]));
    }
    const double safety = 0.9 * (2*MOST_ITERATIONS + 1) / (2*MOST_ITERATIONS + iterations);
    double error = error_of(s, h, s->f);
    if (error > 1 && s->rejected_last) {
      for (int64_t i = 0; i < n; i++) s->first[i] = s->x[i] + s->error[i];
      rates_at(s, s->t, s->first, s->k);
      error = error_of(s, h, s->k);
    }
    if (error <= 1) {
      accept(s, h, error, safety, iterations > 2 && rate > SLOWLY);
      return 1;
    }
    s->rejected++;
    s->rejected_last = 1;
    h *= error < INFINITY ? fmax(LEAST_FACTOR, safety * factor(s, h, error)) : 0.1;
  }
}

void lmoc_radau_within(const lmoc_radau *s, double time, double *out) {
  const int64_t n = s->n;
  const double theta = (time - s->before) / s->length;
  for (int64_t i = 0; i < n; i++)
    out[i] = s->last[i] + theta * (s->dense[i] + theta * (s->dense[n + i] + theta * s->dense[2*n + i]));
}
