/* The length of a first step. */

#include "engine.h"

static double norm(int64_t n, double rtol, const double *atol, const double *x, const double *v, const double *minus) {
  double sum = 0;
  for (int64_t i = 0; i < n; i++) {
    const double q = (minus ? v[i] - minus[i] : v[i]) / (atol[i] + rtol*fabs(x[i]));
    sum += q*q;
  }
  return sqrt(sum / (double)n);
}

/* A first step size (Hairer, Nørsett, Wanner I, II.4), before f has been evaluated at its end … */
double lmoc_first_trial(int64_t n, double span, double longest, double least, double rtol, const double *atol,
                        const double *x, const double *f) {
  const double d0 = norm(n, rtol, atol, x, x, 0), d1 = norm(n, rtol, atol, x, f, 0);
  double h = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01*d0/d1;
  if (least > h) h = least;  /* the slope may have no finite norm */
  if (span < h) h = span;
  return longest < h ? longest : h;
}

/* … and behind that. */
double lmoc_first_step(int64_t n, double h, double span, double rtol, const double *atol, const double *x,
                       const double *f, const double *trial) {
  const double d1 = norm(n, rtol, atol, x, f, 0), d2 = norm(n, rtol, atol, x, trial, f) / h;
  if (!(d2*0 == 0)) return h * 1e-3;
  const double steepest = d2 > d1 ? d2 : d1;
  double first = steepest <= 1e-15 ? fmax(1e-6, h*1e-3) : pow(0.01 / steepest, 0.125);
  if (!(100*h > first)) first = 100*h;
  return span < first ? span : first;
}
