/* A step of DOP853 without Python between its stages. */

#include "engine.h"

/* Some rows of out = x + h*sum_j a[j]*k[j] over the stages with a coefficient. */
#define SUMS(type, rows) \
  for (; i + (rows)*(int64_t)(sizeof(type)/sizeof(double)) <= n; i += (rows)*(int64_t)(sizeof(type)/sizeof(double))) { \
    type sum[rows]; \
    for (int r = 0; r < (rows); r++) sum[r] = (type){0}; \
    for (int j = 0; j < stages; j++) { \
      const type *own = (const type *)(k + j*n + i); \
      if (a[j] != 0) for (int r = 0; r < (rows); r++) sum[r] += a[j] * own[r]; \
    } \
    for (int r = 0; r < (rows); r++) ((type *)(out + i))[r] = ((const type *)(x + i))[r] + h*sum[r]; \
  }

LMOC_WIDEST void lmoc_dop853_stage(int64_t n, int stages, const double *a, double h, const double *x, const double *k,
                                   double *out) {
  int64_t i = 0;
  SUMS(lmoc_together, 3)
  SUMS(lmoc_together, 1)
  SUMS(double, 1)
}

/* f at a stage, with the inputs that Python has given for it. */
static void at(lmoc_call *c, int s, double time, double *x, double *f) {
  const int64_t inputs = c->given - c->n;
  if (inputs) memcpy(x + c->n, c->samples + s*inputs, inputs * sizeof(double));
  lmoc_derivatives(c, time, x, f);
}

void lmoc_dop853_attempt(lmoc_call *c, double time, double h, double rtol, const double *a, const double *times,
                         const double *x, const double *atol, double *k, double *x_new, double *last,
                         double *result) {
  const int64_t n = c->n;
  for (int s = 1; s < 12; s++) {
    lmoc_dop853_stage(n, s, a + 16*s, h, x, k, last);
    at(c, s, time + times[s]*h, last, k + s*n);
  }
  lmoc_dop853_stage(n, 12, a + 16*16, h, x, k, x_new);
  at(c, 12, time + h, x_new, k + 12*n);
  lmoc_dop853_errors(n, h, rtol, a, x, atol, k, x_new, last, result);
}

/* Sums of weighted stages for some states, of all 13. */
#define WEIGHED(type, sum) \
  { \
    type five = {0}, three = {0}; \
    for (int j = 0; j < 13; j++) { \
      const type own = *(const type *)(k + j*n + i); \
      five += w5[j]*own; \
      three += w3[j]*own; \
    } \
    *(type *)(sum) = five; \
    *(type *)(sum + LMOC_TOGETHER) = three; \
  }

LMOC_WIDEST void lmoc_dop853_errors(int64_t n, double h, double rtol, const double *a, const double *x,
                                    const double *atol, const double *k, const double *x_new, const double *last,
                                    double *result) {
  const double *w5 = a + 16*17, *w3 = a + 16*18;
  double e5 = 0, e3 = 0, change = 0, rise = 0, poison = 0;
  for (int64_t i = 0, many; i < n; i += many) {
    double sums[2*LMOC_TOGETHER];
    many = i + LMOC_TOGETHER <= n ? LMOC_TOGETHER : 1;
    if (many > 1) WEIGHED(lmoc_together, sums) else WEIGHED(double, sums)
    for (int64_t p = i; p < i + many; p++) {
      const double s5 = sums[p - i], s3 = sums[LMOC_TOGETHER + p - i];
      const double scale = atol[p] + rtol*fmax(fabs(x[p]), fabs(x_new[p]));
      e5 += (s5/scale)*(s5/scale);
      e3 += (s3/scale)*(s3/scale);
      const double dx = x_new[p] - last[p], df = k[12*n + p] - k[11*n + p];
      change += dx*dx;
      rise += df*df;
      poison += 0*k[12*n + p];  /* the error weights alone may hide a NaN at the end of the step */
    }
  }
  result[0] = h*e5/sqrt((e5 + 0.01*e3 + 1e-300)*n) + poison;
  result[1] = change > 0 ? h*sqrt(rise/change) : 0;
}

void lmoc_dop853_more(lmoc_call *c, double time, double h, const double *a, const double *times, const double *x,
                      double *k, double *work) {
  for (int s = 13; s < 16; s++) {
    lmoc_dop853_stage(c->n, s, a + 16*s, h, x, k, work);
    at(c, s, time + times[s]*h, work, k + s*c->n);
  }
  if (c->marked) lmoc_go_back(c);
}
