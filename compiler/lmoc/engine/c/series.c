/* Taylor coefficients by their recurrences (`recurrence.h`). A block takes Newton's method for order zero alone; every further
   order is one solution with the same matrix (Nedialkov and Pryce, Solving DAEs by Taylor series (I), BIT 45, 2005). */

#include "series.h"

#include "blocks.h"
#include "recurrence.h"

#define S(i) (s + (int64_t)(i)*LMOC_LENGTH)
#define W(place) LMOC_ROW(w, place)
#define ZERO ((lmoc_real){0})

void LMOC_NAME(lmoc_series_open)(const lmoc_series *y, int64_t block, int64_t k) {
  const lmoc_block *m = y->start->blocks + block;
  lmoc_real *s = (lmoc_real *)y->s;
  for (int64_t i = 0; i < m->instances*m->size; i++) S(y->of_register[m->unknowns[i]])[k] = ZERO;
}

void LMOC_NAME(lmoc_series_solve)(const lmoc_series *y, int64_t block, int64_t k) {
  const lmoc_block *m = y->start->blocks + block;
  double *b = y->w + LMOC_AT(m->b);
  lmoc_real *s = (lmoc_real *)y->s;
  for (int64_t i = 0; i < m->instances; i++) {
    const int32_t *u = m->unknowns + i*m->size, *r = m->residuals + i*m->size;
    for (int64_t j = 0; j < m->size; j++) LMOC_ROW(b, j) = -S(y->of_register[r[j]])[k];
    LMOC_NAME(lmoc_block_substitute)(m, i, y->w, b);
    for (int64_t j = 0; j < m->size; j++) S(y->of_register[u[j]])[k] = LMOC_ROW(b, j);
  }
}

int LMOC_NAME(lmoc_series_begin)(const lmoc_series *y, lmoc_times time) {
  lmoc_real *s = (lmoc_real *)y->s;
  double *w = y->w;
  const int failed = y->start->run(time, w, y->start);
  for (int64_t i = 0; i < y->count; i++) S(i)[0] = W(y->source[i]);
  if (y->clock < 0) return failed;
  double *clock = (double *)S(y->clock);
  LMOC_EACH_LANE {
    clock[l] = LMOC_TIME(time, l);
    clock[LMOC_LANES + l] = 1;
  }
  return failed;
}

enum {
#define X(name) SERIES_##name,
  LMOC_RECURRENCES(X)
#undef X
};

LMOC_WIDEST void LMOC_NAME(lmoc_series_order)(const lmoc_series *y, int64_t k) {
  lmoc_real *s = (lmoc_real *)y->s;
  double *w = y->w;
  for (const int32_t *p = y->code;; p += 4) {
    lmoc_real *out = S(p[1]);
    switch (p[0]) {
      case SERIES_end: return;
      case SERIES_copy: out[k] = S(p[2])[k]; break;
      case SERIES_neg: out[k] = -S(p[2])[k]; break;
      case SERIES_add: out[k] = S(p[2])[k] + S(p[3])[k]; break;
      case SERIES_sub: out[k] = S(p[2])[k] - S(p[3])[k]; break;
      case SERIES_scale: out[k] = W(p[3]) * S(p[2])[k]; break;
      case SERIES_ratio: out[k] = S(p[2])[k] / W(p[3]); break;
      case SERIES_convolve: out[k] = lmoc_convolve(k, S(p[2]), S(p[3])); break;
      case SERIES_square: out[k] = lmoc_square(k, S(p[2])); break;
      case SERIES_quotient: {
        const lmoc_real *b = S(p[3]);
        out[k] = ((p[2] < 0 ? ZERO : S(p[2])[k]) - lmoc_rest(k, b, out)) / b[0];
        break;
      }
      case SERIES_power: out[k] = lmoc_power(k, S(p[2]), W(p[3]), out); break;
      case SERIES_chain: out[k] = lmoc_chain(k, S(p[2]), S(p[3])); break;
      case SERIES_chain_more: out[k] += lmoc_chain(k, S(p[2]), S(p[3])); break;
      case SERIES_scale_more: out[k] += W(p[3]) * S(p[2])[k]; break;
      case SERIES_of_time: out[k] = lmoc_of_time(k, S(p[2]), S(p[3])); break;
      case SERIES_late: out[k] += S(p[2])[0] * S(p[3])[k]; break;
      case SERIES_total: {
        lmoc_real sum = ZERO;
        const int32_t *q = p + 4;
        for (int32_t j = 0; j < p[2]; j++, q += 2) sum += W(q[1]) * S(q[0])[k];
        out[k] = sum;
        p = q - 4;
        break;
      }
      case SERIES_open: y->open(y, p[2], k); break;
      case SERIES_solve: y->solve(y, p[2], k); break;
    }
  }
}

#if !LMOC_OF_LANES

/* The names of the instructions in the order of their numbers. */
const char *lmoc_recurrences(void) {
  return ""
#define X(name) #name " "
    LMOC_RECURRENCES(X)
#undef X
    ;
}

#endif
