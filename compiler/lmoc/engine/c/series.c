/* The recurrences of Taylor coefficients (Moore, Methods and Applications of Interval Analysis, 1979; Griewank and
   Walther, Evaluating Derivatives, 2008, chapter 13). A block takes Newton's method for order zero alone; every further
   order is one solution with the same matrix (Nedialkov and Pryce, Solving DAEs by Taylor series (I), BIT 45, 2005). */

#include "series.h"

#include "blocks.h"

#define S(i) (s + (int64_t)(i)*LMOC_LENGTH)

/* Sums in two parts, so that an addition does not wait for the one before. */
static inline double convolve(int64_t k, const double *a, const double *b) {
  double even = 0, odd = 0;
  int64_t j = 0;
  for (; j < k; j += 2) {
    even += a[j] * b[k - j];
    odd += a[j + 1] * b[k - j - 1];
  }
  return j == k ? even + odd + a[k]*b[0] : even + odd;
}

static inline double square(int64_t k, const double *a) {
  double sum = 0;
  int64_t j = 0;
  for (; 2*j < k; j++) sum += a[j] * a[k - j];
  return 2*j == k ? 2*sum + a[j]*a[j] : 2*sum;
}

/* sum of b[j]*c[k - j] over j = 1 … k */
static inline double rest(int64_t k, const double *b, const double *c) {
  double even = 0, odd = 0;
  int64_t j = 1;
  for (; j < k; j += 2) {
    even += b[j] * c[k - j];
    odd += b[j + 1] * c[k - j - 1];
  }
  return j == k ? even + odd + b[k]*c[0] : even + odd;
}

/* with f' = g x' */
static inline double chain(int64_t k, const double *x, const double *g) {
  double even = 0, odd = 0;
  int64_t j = 1;
  for (; j < k; j += 2) {
    even += (double)j * x[j] * g[k - j];
    odd += (double)(j + 1) * x[j + 1] * g[k - j - 1];
  }
  if (j == k) even += (double)k * x[k] * g[0];
  return (even + odd) / (double)k;
}

static inline double power(int64_t k, const double *a, double p, const double *c) {
  double sum = 0;
  for (int64_t j = 0; j < k; j++) sum += (p * (double)(k - j) - (double)j) * a[k - j] * c[j];
  return sum / ((double)k * a[0]);
}

static void solve(const lmoc_series *y, const lmoc_block *m, int64_t k) {
  double *b = y->w + m->b, *s = y->s;
  for (int64_t i = 0; i < m->instances; i++) {
    const int32_t *u = m->unknowns + i*m->size, *r = m->residuals + i*m->size;
    for (int64_t j = 0; j < m->size; j++) b[j] = -S(y->of_register[r[j]])[k];
    lmoc_block_solve(m, y->w + m->a + i*m->each, m->pivots + i*m->size, b);
    for (int64_t j = 0; j < m->size; j++) S(y->of_register[u[j]])[k] = b[j];
  }
}

int lmoc_series_begin(const lmoc_series *y, double time) {
  double *s = y->s;
  if (y->start->run(time, y->w, y->start)) return 1;
  for (int64_t i = 0; i < y->count; i++) S(i)[0] = y->w[y->source[i]];
  if (y->clock >= 0) {
    S(y->clock)[0] = time;
    S(y->clock)[1] = 1;
  }
  return 0;
}

enum {
#define X(name) SERIES_##name,
  LMOC_RECURRENCES(X)
#undef X
};

void lmoc_series_order(const lmoc_series *y, int64_t k) {
  double *s = y->s;
  const double *w = y->w;
  for (const int32_t *p = y->code;; p += 4) {
    double *out = S(p[1]);
    switch (p[0]) {
      case SERIES_end: return;
      case SERIES_copy: out[k] = S(p[2])[k]; break;
      case SERIES_neg: out[k] = -S(p[2])[k]; break;
      case SERIES_add: out[k] = S(p[2])[k] + S(p[3])[k]; break;
      case SERIES_sub: out[k] = S(p[2])[k] - S(p[3])[k]; break;
      case SERIES_scale: out[k] = w[p[3]] * S(p[2])[k]; break;
      case SERIES_ratio: out[k] = S(p[2])[k] / w[p[3]]; break;
      case SERIES_convolve: out[k] = convolve(k, S(p[2]), S(p[3])); break;
      case SERIES_square: out[k] = square(k, S(p[2])); break;
      case SERIES_quotient: {
        const double *b = S(p[3]);
        out[k] = ((p[2] < 0 ? 0 : S(p[2])[k]) - rest(k, b, out)) / b[0];
        break;
      }
      case SERIES_power: out[k] = power(k, S(p[2]), w[p[3]], out); break;
      case SERIES_chain: out[k] = chain(k, S(p[2]), S(p[3])); break;
      case SERIES_chain_more: out[k] += chain(k, S(p[2]), S(p[3])); break;
      case SERIES_scale_more: out[k] += w[p[3]] * S(p[2])[k]; break;
      case SERIES_total: {
        double sum = 0;
        const int32_t *q = p + 4;
        for (int32_t j = 0; j < p[2]; j++, q += 2) sum += w[q[1]] * S(q[0])[k];
        out[k] = sum;
        p = q - 4;
        break;
      }
      case SERIES_open: {
        const lmoc_block *m = y->start->blocks + p[2];
        for (int64_t i = 0; i < m->instances*m->size; i++) S(y->of_register[m->unknowns[i]])[k] = 0;
        break;
      }
      case SERIES_solve: solve(y, y->start->blocks + p[2], k); break;
    }
  }
}

/* The names of the instructions in the order of their numbers. */
const char *lmoc_recurrences(void) {
  return ""
#define X(name) #name " "
    LMOC_RECURRENCES(X)
#undef X
    ;
}
