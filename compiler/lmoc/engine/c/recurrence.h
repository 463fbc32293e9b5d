/* The recurrences of Taylor coefficients (Moore, Methods and Applications of Interval Analysis, 1979; Griewank and
   Walther, Evaluating Derivatives, 2008, chapter 13): the coefficient of order k > 0 from those of lower orders. */

#ifndef LMOC_RECURRENCE_H
#define LMOC_RECURRENCE_H

#include "lane.h"

/* Sums in two parts, so that an addition does not wait for the one before. */
LMOC_INLINE lmoc_real lmoc_convolve(int64_t k, const lmoc_real *a, const lmoc_real *b) {
  lmoc_real even = {0}, odd = {0};
  int64_t j = 0;
  for (; j < k; j += 2) {
    even += a[j] * b[k - j];
    odd += a[j + 1] * b[k - j - 1];
  }
  return j == k ? even + odd + a[k]*b[0] : even + odd;
}

LMOC_INLINE lmoc_real lmoc_square(int64_t k, const lmoc_real *a) {
  lmoc_real sum = {0};
  int64_t j = 0;
  for (; 2*j < k; j++) sum += a[j] * a[k - j];
  return 2*j == k ? 2*sum + a[j]*a[j] : 2*sum;
}

/* sum of b[j]*c[k - j] over j = 1 … k */
LMOC_INLINE lmoc_real lmoc_rest(int64_t k, const lmoc_real *b, const lmoc_real *c) {
  lmoc_real even = {0}, odd = {0};
  int64_t j = 1;
  for (; j < k; j += 2) {
    even += b[j] * c[k - j];
    odd += b[j + 1] * c[k - j - 1];
  }
  return j == k ? even + odd + b[k]*c[0] : even + odd;
}

/* with f' = g x' */
LMOC_INLINE lmoc_real lmoc_chain(int64_t k, const lmoc_real *x, const lmoc_real *g) {
  lmoc_real even = {0}, odd = {0};
  int64_t j = 1;
  for (; j < k; j += 2) {
    even += (double)j * x[j] * g[k - j];
    odd += (double)(j + 1) * x[j + 1] * g[k - j - 1];
  }
  if (j == k) even += (double)k * x[k] * g[0];
  return (even + odd) / (double)k;
}

/* the same where x has no coefficients beyond the first, as a phase that grows with time */
LMOC_INLINE lmoc_real lmoc_of_time(int64_t k, const lmoc_real *x, const lmoc_real *g) {
  return x[1] * g[k - 1] / (double)k;
}

LMOC_INLINE lmoc_real lmoc_power(int64_t k, const lmoc_real *a, lmoc_real p, const lmoc_real *c) {
  lmoc_real sum = {0};
  for (int64_t j = 0; j < k; j++) sum += (p * (double)(k - j) - (double)j) * a[k - j] * c[j];
  return sum / ((double)k * a[0]);
}

#endif
