/* A step of DOP853 without Python between its stages. */

#include "engine.h"

/* out = x + h*sum_j a[j]*k[j] over the stages with a coefficient, in pieces that stay in the cache */
static void stage(int64_t n, int stages, const double *a, double h, const double *x, const double *k,
                       double *out) {
  for (int64_t low = 0; low < n; low += 1024) {
    const int64_t high = low + 1024 < n ? low + 1024 : n;
    for (int64_t i = low; i < high; i++) out[i] = 0;
    for (int j = 0; j < stages; j++) {
      const double b = a[j], *kj = k + j*n;
      if (b != 0) for (int64_t i = low; i < high; i++) out[i] += b * kj[i];
    }
    for (int64_t i = low; i < high; i++) out[i] = x[i] + h * out[i];
  }
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
    stage(n, s, a + 16*s, h, x, k, last);
    at(c, s, time + times[s]*h, last, k + s*n);
  }
  stage(n, 12, a + 16*16, h, x, k, x_new);
  at(c, 12, time + h, x_new, k + 12*n);
  const double *w5 = a + 16*17, *w3 = a + 16*18;
  double e5 = 0, e3 = 0, change = 0, rise = 0, poison = 0;
  for (int64_t i = 0; i < n; i++) {
    double s5 = 0, s3 = 0;
    for (int j = 0; j < 13; j++) { s5 += w5[j]*k[j*n + i]; s3 += w3[j]*k[j*n + i]; }
    const double scale = atol[i] + rtol*fmax(fabs(x[i]), fabs(x_new[i]));
    e5 += (s5/scale)*(s5/scale);
    e3 += (s3/scale)*(s3/scale);
    const double dx = x_new[i] - last[i], df = k[12*n + i] - k[11*n + i];
    change += dx*dx;
    rise += df*df;
    poison += 0*k[12*n + i];  /* the error weights alone may hide a NaN at the end of the step */
  }
  result[0] = h*e5/sqrt((e5 + 0.01*e3 + 1e-300)*n) + poison;
  result[1] = change > 0 ? h*sqrt(rise/change) : 0;
}

void lmoc_dop853_more(lmoc_call *c, double time, double h, const double *a, const double *times, const double *x,
                      double *k, double *work) {
  for (int s = 13; s < 16; s++) {
    stage(c->n, s, a + 16*s, h, x, k, work);
    at(c, s, time + times[s]*h, work, k + s*c->n);
  }
  if (c->marked) lmoc_go_back(c);
}
