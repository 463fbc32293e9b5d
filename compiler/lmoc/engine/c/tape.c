/* The interpreter of tapes. */

#include "copies.h"
#include "newton.h"

/* Operands of a vector instruction: where a chunk begins, and whether it goes on from chunk to chunk (1), is a buffer
   (0), or is one number for all rows (-1). */
#define PLACE(k) (w + LMOC_AT(p[k]) + (p[(k) + 1] > 0 ? LMOC_AT(low) : 0))
#define EACH _Pragma("GCC ivdep") for (int64_t i = 0; i < m*LMOC_LANES; i++)
#define ROWS _Pragma("GCC ivdep") for (int64_t i = 0; i < m; i++) LMOC_EACH_LANE
#define EACH_ROW _Pragma("GCC ivdep") for (int64_t i = 0; i < m; i++)
/* A loop over the lanes: as one operation where the processor has it, which a compiler that has unrolled it would not see. */
#define TOGETHER _Pragma("GCC unroll 1") _Pragma("GCC ivdep") LMOC_EACH_LANE

/* One vector instruction on rows low … low + m - 1; returns its length. */
LMOC_WIDEST static int lmoc_chunk(const int32_t *p, double *w, const int32_t *index, int64_t low, int64_t m) {
  double *out = w + LMOC_AT(p[1]) + (p[2] > 0 ? LMOC_AT(low) : 0);
  switch (p[0]) {
#if LMOC_LANES > 1
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3); \
      EACH_ROW { const lmoc_real x = LMOC_ROW(a, i); LMOC_ROW(out, i) = value; } \
      return 5; \
    }
    LMOC_UNARY_OF_ROWS(X)
#undef X
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3), *b = PLACE(5); \
      const int64_t one = p[4] >= 0, two = p[6] >= 0; \
      EACH_ROW { const lmoc_real x = LMOC_ROW(a, i*one), y = LMOC_ROW(b, i*two); LMOC_ROW(out, i) = value; } \
      return 7; \
    }
    LMOC_BINARY_OF_ROWS(X)
#undef X
#define UNARY LMOC_UNARY_OF_ONE
#define BINARY LMOC_BINARY_OF_ONE
#else
#define UNARY LMOC_UNARY
#define BINARY LMOC_BINARY
#endif
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3); \
      EACH { const double x = a[i]; out[i] = value; } \
      return 5; \
    }
    UNARY(X)
#undef X
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3), *b = PLACE(5); \
      if (p[4] < 0) ROWS { const double x = a[l], y = b[LMOC_AT(i) + l]; out[LMOC_AT(i) + l] = value; } \
      else if (p[6] < 0) ROWS { const double x = a[LMOC_AT(i) + l], y = b[l]; out[LMOC_AT(i) + l] = value; } \
      else EACH { const double x = a[i], y = b[i]; out[i] = value; } \
      return 7; \
    }
    BINARY(X)
#undef X
    case LMOC_if: {
      const double *c = PLACE(3), *a = PLACE(5), *b = PLACE(7);
      const int64_t one = LMOC_AT(p[4] >= 0), two = LMOC_AT(p[6] >= 0), three = LMOC_AT(p[8] >= 0);
      for (int64_t i = 0; i < m; i++)
        LMOC_EACH_LANE out[LMOC_AT(i) + l] = c[i*one + l] != 0 ? a[i*two + l] : b[i*three + l];
      return 9;
    }
    case LMOC_gather: {
      const int32_t *from = index + p[3] + low;
      EACH_ROW LMOC_ROW(out, i) = LMOC_ROW(w, from[i]);
      return 4;
    }
    case LMOC_strided: {
      const double *from = w + LMOC_AT(p[3] + low*p[4]);
      const int64_t stride = p[4];
      EACH_ROW LMOC_ROW(out, i) = LMOC_ROW(from, i*stride);
      return 5;
    }
    case LMOC_scatter: {
      const int32_t *to = index + p[3] + low;
      const double *a = out;
      EACH_ROW LMOC_ROW(w, to[i]) = LMOC_ROW(a, i);
      return 4;
    }
    case LMOC_spread: {
      double *to = w + LMOC_AT(p[3] + low*p[4]);
      const int64_t stride = p[4];
      const double *a = out;
      EACH_ROW LMOC_ROW(to, i*stride) = LMOC_ROW(a, i);
      return 5;
    }
  }
  return 1 << 30;
}

/* A loop over rows, some of them at a time: all that is done to these before the next ones are begun. */
int LMOC_NAME(lmoc_rows)(const int32_t *p, double *w, const lmoc_tape *t) {
  const int64_t n = p[1];
  const int32_t *end = p + p[2];
  int status = 0;
  for (int64_t low = 0; low < n; low += LMOC_CHUNK) {
    const int64_t m = n - low < LMOC_CHUNK ? n - low : LMOC_CHUNK;
#if !LMOC_OF_LANES
    int64_t iteration = 0;
#endif
    for (const int32_t *q = p + 3; q < end;) switch (q[0]) {
      case LMOC_linear: LMOC_NAME(lmoc_copies_linear)(t->blocks + q[2], q, w, low, m); q += q[1]; break;
#if !LMOC_OF_LANES
      case LMOC_newton: lmoc_copies_begin(t->blocks + q[2], w, low, m); iteration = 0; q += q[1]; break;
      case LMOC_correct: {
        const lmoc_block *block = t->blocks + q[2];
        const int64_t left = lmoc_copies_correct(block, q, w, low, m, iteration);
        if (left && iteration++ < lmoc_newton_rules[block->patient].most) q = p + q[3];
        else {
          status |= lmoc_copies_end(block, w, low, m);
          q += q[1];
        }
        break;
      }
#endif
      default: q += lmoc_chunk(q, w, t->index, low, m);
    }
  }
  return status;
}

#define W(place) LMOC_ROW(w, place)
#define ZERO ((lmoc_real){0})

/* w[out[k]] = sum of w[factor[j]]*w[source[j]] over the j of segment k. A negative table counts places from there on, and
   there may be neither factors nor segments of more than one. */
LMOC_WIDEST static void lmoc_products(const int32_t *p, double *w, const int32_t *index) {
  const int64_t n = p[1];
  const int32_t *out = index + p[2], *source = index + p[5];
  const int32_t *start = p[3] < 0 ? 0 : index + p[3], *factor = p[4] < 0 ? 0 : index + p[4];
  if (!start) {
    for (int64_t k = 0; k < n; k++) W(out[k]) = W(factor[k]) * W(source[k]);
    return;
  }
  if (!factor) {
    for (int64_t k = 0; k < n; k++) {
      lmoc_real s = ZERO;
      for (int32_t j = start[k]; j < start[k + 1]; j++) s += W(source[j]);
      W(out[k]) = s;
    }
    return;
  }
  for (int64_t k = 0; k < n; k++) {
    lmoc_real s = ZERO;
    for (int32_t j = start[k]; j < start[k + 1]; j++) s += W(factor[j]) * W(source[j]);
    W(out[k]) = s;
  }
}

#if defined(__GNUC__) && LMOC_LANES == 1
#define JUMPS 1
#define NEXT goto *go[*p]
#define CASE(name) do_##name
#define RUN /* which the compiler does not clone, with its table of places to jump to */
#else
#define JUMPS 0
#define NEXT continue
#define CASE(name) case LMOC_##name
#define RUN LMOC_WIDEST
#endif
#define ONE(place) (w + LMOC_AT(p[place]))

RUN int LMOC_NAME(lmoc_tape_run)(lmoc_times time, double *w, const lmoc_tape *t) {
#if JUMPS
  static const void *const go[] = {
    &&do_end,
#define X(name, ...) &&do_##name,
    LMOC_UNARY(X) LMOC_BINARY(X) LMOC_OTHER(X)
#undef X
  };
#endif
  const int32_t *p = t->code;
  int status = 0;
  LMOC_EACH_LANE w[LMOC_AT(t->time) + l] = LMOC_TIME(time, l);
#if JUMPS
  NEXT;
#else
  for (;;) switch (*p) {
#endif
#define X(name, value) \
  CASE(name): { \
    const lmoc_real x = W(p[2]); \
    W(p[1]) = value; \
    p += 3; \
    NEXT; \
  }
  LMOC_UNARY_OF_ROWS(X)
#undef X
#define X(name, value) \
  CASE(name): { \
    const lmoc_real x = W(p[2]), y = W(p[3]); \
    W(p[1]) = value; \
    p += 4; \
    NEXT; \
  }
  LMOC_BINARY_OF_ROWS(X)
#undef X
#define X(name, value) \
  CASE(name): { \
    const double *a = ONE(2); \
    double *out = ONE(1); \
    TOGETHER { const double x = a[l]; out[l] = value; } \
    p += 3; \
    NEXT; \
  }
  LMOC_UNARY_OF_ONE(X)
#undef X
#define X(name, value) \
  CASE(name): { \
    const double *a = ONE(2), *b = ONE(3); \
    double *out = ONE(1); \
    TOGETHER { const double x = a[l], y = b[l]; out[l] = value; } \
    p += 4; \
    NEXT; \
  }
  LMOC_BINARY_OF_ONE(X)
#undef X
  CASE(if):
    LMOC_EACH_LANE ONE(1)[l] = ONE(2)[l] != 0 ? ONE(3)[l] : ONE(4)[l];
    p += 5;
    NEXT;
  CASE(dot): {
    const int32_t *end = p + 3 + 2*p[2];
    lmoc_real s = W(p[3]) * W(p[4]);
    for (const int32_t *q = p + 5; q < end; q += 2) s += W(q[0]) * W(q[1]);
    W(p[1]) = s;
    p = end;
    NEXT;
  }
  CASE(rows): status |= LMOC_NAME(lmoc_rows)(p, w, t); p += p[2]; NEXT;
  CASE(products): lmoc_products(p, w, t->index); p += 6; NEXT;
  CASE(fill): {
    const lmoc_real value = W(p[3]);
    const int32_t *out = t->index + p[2];
    for (int64_t k = 0; k < p[1]; k++) W(out[k]) = value;
    p += 4;
    NEXT;
  }
  CASE(linear): t->functions->linear(t->blocks + p[1], w); p += 2; NEXT;
  CASE(newton): t->functions->newton_begin(t->blocks + p[1], w); p += 2; NEXT;
  CASE(correct): {
    const int64_t open = t->functions->newton_step(t->blocks + p[1], w);
    if (open > 0) p = t->code + p[2];
    else {
      status |= t->functions->newton_end(t->blocks + p[1], w, open);
      p += 3;
    }
    NEXT;
  }
  CASE(ready): p = t->blocks[p[1]].ready ? t->code + p[2] : p + 3; NEXT;
  CASE(constant): t->functions->constant(t->blocks + p[1], w); p += 2; NEXT;
  CASE(implicit): t->functions->implicit(t->blocks + p[1], w); p += 2; NEXT;
  CASE(factor): status |= t->functions->factor(t->blocks + p[1], w); p += 2; NEXT;
  CASE(gather): CASE(strided): CASE(scatter): CASE(spread): /* only inside of rows */
  CASE(end): return status;
#if !JUMPS
  }
#endif
}

#if !LMOC_OF_LANES

/* The names of the operations in the order of their numbers. */
const char *lmoc_operations(void) {
  return "end"
#define X(name, ...) " " #name
    LMOC_UNARY(X) LMOC_BINARY(X) LMOC_OTHER(X)
#undef X
    ;
}

#endif
