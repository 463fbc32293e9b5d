/* Blocks of many equal copies: Gauss elimination of rows on several of them at once, each with its own pivots. What depends
   on a copy is chosen, not jumped to. */

#include "copies.h"

#include "newton.h"

enum { LARGEST = 12 }; /* unknowns (`DENSE_IN_C`) */

#if LMOC_TOGETHER > 1 && !defined(__wasm__) /* where a text in pages that is short is worth more */
#define ABREAST LMOC_TOGETHER
#define INLINE LMOC_INLINE
typedef lmoc_together some; /* numbers of so many copies, or lanes */
typedef int64_t which __attribute__((vector_size(8*ABREAST)));
#define CHOOSE(c, x, y) ((some)(((c) & (which)(x)) | (~(c) & (which)(y))))
#define SIZE_OF(x) ((some)((which)(x) & INT64_MAX))
#else
#define ABREAST 1
#define INLINE static
typedef double some;
typedef int64_t which;
#define CHOOSE(c, x, y) ((c) ? (x) : (y))
#define SIZE_OF(x) fabs(x)
#endif
#define ALL(value) ((some){0} + (value))
#define LARGER(x, y) CHOOSE((x) > (y), x, y)
#define FINITE(x) ((x) * 0 == ALL(0))

/* Some numbers of an operand; the last one again where there are fewer. */
INLINE some fetch(const int32_t *pair, const double *w, int64_t low, int64_t first, int64_t here) {
  const double *from = w + LMOC_AT(pair[0]) + (pair[1] > 0 ? LMOC_AT(low) : 0);
  if (pair[1] < 0 && LMOC_LANES == 1) return ALL(from[0]);
  from += pair[1] < 0 ? first % LMOC_LANES : first;
  if (here == ABREAST) return *(const some *)from;
  some found;
  for (int64_t e = 0; e < ABREAST; e++) ((double *)&found)[e] = from[e < here ? e : here - 1];
  return found;
}

INLINE void put(double *to, some value, int64_t here) {
  if (here == ABREAST) *(some *)to = value;
  else memcpy(to, &value, here * sizeof(double));
}

/* Exchange rows where the lower one has the larger entry in column k. */
INLINE void exchange(int64_t n, int64_t k, some *own, some *lower, some *b, some *below, some *det) {
  const which up = SIZE_OF(lower[k]) > SIZE_OF(own[k]);
  for (int64_t j = k; j < n; j++) {
    const some x = own[j], y = lower[j];
    own[j] = CHOOSE(up, y, x);
    lower[j] = CHOOSE(up, x, y);
  }
  const some x = *b, y = *below;
  *b = CHOOSE(up, y, x);
  *below = CHOOSE(up, x, y);
  *det = CHOOSE(up, -*det, *det);
}

/* b := A^-1 b, no numbers where a pivot is zero or no number; the determinant. */
INLINE void eliminate(const int64_t n, some *a, some *b, some *det) {
  some lost = ALL(0);
  *det = ALL(1);
  for (int64_t k = 0; k < n; k++) {
    some *own = a + k*n;
    for (int64_t i = k + 1; i < n; i++) exchange(n, k, own, a + i*n, b + k, b + i, det);
    *det *= own[k];
    lost = CHOOSE((own[k] != 0) & FINITE(own[k]), lost, ALL(NAN));
    for (int64_t i = k + 1; i < n; i++) {
      some *row = a + i*n;
      const some f = row[k] / own[k];
      for (int64_t j = k + 1; j < n; j++) row[j] -= f * own[j];
      b[i] -= f * b[k];
    }
  }
  for (int64_t k = n - 1; k >= 0; k--) {
    for (int64_t j = k + 1; j < n; j++) b[k] -= a[k*n + j] * b[j];
    b[k] = b[k] / a[k*n + k];
  }
  for (int64_t k = 0; k < n; k++) b[k] = CHOOSE(lost == lost, b[k], lost);
}

INLINE void solve_linear(const int64_t n, const int32_t *p, double *w, int64_t low, int64_t count) {
  const int64_t all = LMOC_AT(count);
  const int32_t *entries = p + 3, *residuals = entries + 2*n*n, *out = residuals + 2*n;
  some a[LARGEST*LARGEST], b[LARGEST], det;
  for (int64_t first = 0; first < all; first += ABREAST) {
    const int64_t here = all - first < ABREAST ? all - first : ABREAST;
    for (int64_t k = 0; k < n*n; k++) a[k] = fetch(entries + 2*k, w, low, first, here);
    for (int64_t k = 0; k < n; k++) b[k] = -fetch(residuals + 2*k, w, low, first, here);
    eliminate(n, a, b, &det);
    for (int64_t k = 0; k < n; k++)
      put(w + LMOC_AT(out[2*k]) + (out[2*k + 1] > 0 ? LMOC_AT(low) : 0) + first, b[k], here);
  }
}

LMOC_WIDEST void LMOC_NAME(lmoc_copies_linear)(const lmoc_block *m, const int32_t *p, double *w, int64_t low,
                                               int64_t count) {
  switch (ABREAST > 1 ? m->size : 0) { /* sizes that the compiler knows */
    case 1: solve_linear(1, p, w, low, count); break;
    case 2: solve_linear(2, p, w, low, count); break;
    case 3: solve_linear(3, p, w, low, count); break;
    default: solve_linear(m->size, p, w, low, count);
  }
}

#if !LMOC_OF_LANES

enum { SOLVED = -1, FAILS = -2 }; /* in the place of the length of a correction */

void lmoc_copies_begin(const lmoc_block *m, double *w, int64_t low, int64_t count) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  for (int64_t k = low*m->size; k < (low + count)*m->size; k++) s.start[k] = w[m->unknowns[k]];
  for (int64_t i = low; i < low + count; i++) s.before[i] = INFINITY;
}

/* Whether the residuals vanish to rounding: the terms of row k are |a(k,j) u(j)|, and finite. */
INLINE which vanishes(int64_t n, const some *a, const some *u, const some *r) {
  which found = ALL(0) == ALL(0);
  for (int64_t k = 0; k < n; k++) {
    some terms = ALL(0);
    for (int64_t j = 0; j < n; j++) terms += SIZE_OF(a[k*n + j] * u[j]);
    found &= (SIZE_OF(r[k]) <= LMOC_ROUNDING * terms) & (terms < ALL(INFINITY));
  }
  return found;
}

/* Corrections b of some copies from their residuals there; which of them go there. `before` holds the lengths of the last
   ones before, and those of these after it. */
INLINE which corrections(int64_t n, some *a, const some *u, some *b, double rate, int64_t iteration, some *det,
                              some *before) {
  const which vanish = vanishes(n, a, u, b), open = *before >= 0;
  some scale = ALL(1), length = ALL(0);
  for (int64_t k = 0; k < n; k++) scale = LARGER(1 + SIZE_OF(u[k]), scale);
  eliminate(n, a, b, det);
  for (int64_t k = 0; k < n; k++) length = CHOOSE((length > SIZE_OF(b[k])) | (length != length), length, SIZE_OF(b[k]));
  const which shorter = (length <= rate * *before) & (length <= LMOC_LOOSE * scale);
  const some share = CHOOSE(vanish, CHOOSE(shorter, ALL(1), ALL(0)), ALL(1));
  for (int64_t k = 0; k < n; k++) b[k] = CHOOSE(share == 0, ALL(0), b[k]);
  length = CHOOSE(share == 0, ALL(0), length);
  which stops = length > rate * *before;
  if (!iteration) stops = length != length;
  const which good = FINITE(length) & ((length <= LMOC_LOOSE * scale) | (stops == 0));
  const which arrived = LMOC_NEWTON_ARRIVED(length, *before, scale);
  const some next = CHOOSE(stops | arrived, ALL(SOLVED), length);
  *before = CHOOSE(open, CHOOSE(good, next, ALL(FAILS)), *before);
  return open & good & (stops == 0);
}

INLINE int64_t correct(const int64_t n, const lmoc_block *m, const int32_t *p, double *w, int64_t low, int64_t count,
                            int64_t iteration) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  const int32_t *entries = p + 4, *residuals = entries + 2*n*n;
  const double rate = lmoc_newton_rules[m->patient].rate;
  some a[LARGEST*LARGEST], b[LARGEST], u[LARGEST], det;
  int64_t left = 0;
  for (int64_t first = 0; first < count; first += ABREAST) {
    const int64_t here = count - first < ABREAST ? count - first : ABREAST, i = low + first;
    const int32_t *unknowns = m->unknowns + i*n, own[2] = {0, 0};
    some before = fetch(own, s.before + i, 0, 0, here);
    int64_t open = 0;
    for (int64_t e = 0; e < here; e++) open += s.before[i + e] >= 0;
    if (!open) continue;
    for (int64_t k = 0; k < n*n; k++) a[k] = fetch(entries + 2*k, w, low, first, here);
    for (int64_t k = 0; k < n; k++) {
      b[k] = fetch(residuals + 2*k, w, low, first, here);
      for (int64_t e = 0; e < ABREAST; e++) ((double *)(u + k))[e] = w[unknowns[(e < here ? e : here - 1)*n + k]];
    }
    const some was = fetch(own, s.det + i, 0, 0, here);
    const which unsolved = before >= 0, goes = corrections(n, a, u, b, rate, iteration, &det, &before);
    put(s.det + i, CHOOSE(unsolved, det, was), here);
    put(s.before + i, before, here);
    for (int64_t e = 0; e < here; e++) left += s.before[i + e] >= 0;
    for (int64_t k = 0; k < n; k++) {
      const some led = u[k] - b[k], stands = CHOOSE(goes, led, u[k]);
      for (int64_t e = 0; e < here; e++) w[unknowns[e*n + k]] = ((const double *)&stands)[e];
      if (!iteration) for (int64_t e = 0; e < here; e++) s.target[(i + e)*n + k] = ((const double *)&led)[e];
    }
  }
  return left;
}

LMOC_WIDEST int64_t lmoc_copies_correct(const lmoc_block *m, const int32_t *p, double *w, int64_t low, int64_t count,
                                        int64_t iteration) {
  switch (ABREAST > 1 ? m->size : 0) {
    case 1: return correct(1, m, p, w, low, count, iteration);
    case 2: return correct(2, m, p, w, low, count, iteration);
    default: return correct(m->size, m, p, w, low, count, iteration);
  }
}

/* Whether the solution of a copy is not where the first step pointed, near where it began. */
INLINE int far(int64_t n, const int32_t *unknowns, const double *w, const double *start, const double *target,
                    double near) {
  double missed = 0, way = 0, scale = 1;
  int found = 0;
  for (int64_t k = 0; k < n; k++) {
    const double x = w[unknowns[k]], own = fabs(x - start[k]), off = fabs(x - target[k]), size = 1 + fabs(x);
    missed = off > missed ? off : missed;
    way = own > way ? own : way;
    scale = size > scale ? size : scale;
    found |= !(own <= LMOC_WAY * size);
  }
  return found | !(missed <= near * way + LMOC_LOOSE * scale);
}

int lmoc_copies_end(const lmoc_block *m, double *w, int64_t low, int64_t count) {
  const lmoc_newton_state s = lmoc_newton_state_of(m, w);
  const int64_t n = m->size;
  const double near = lmoc_newton_rules[m->patient].near;
  int status = 0;
  for (int64_t i = low; i < low + count; i++) {
    const int32_t *unknowns = m->unknowns + i*n;
    if (s.before[i] == SOLVED) status |= far(n, unknowns, w, s.start + i*n, s.target + i*n, near) * LMOC_FAR;
    else {
      for (int64_t k = 0; k < n; k++) w[unknowns[k]] = NAN;
      status |= LMOC_FAILED;
    }
  }
  return status;
}

#endif
