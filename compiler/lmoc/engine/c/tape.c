/* The interpreter of tapes. */

#include "tape.h"

/* Operands of a vector instruction: where a chunk begins, and whether it goes on from chunk to chunk (1), is a buffer
   (0), or is one number for all rows (-1). */
#define PLACE(k) (w + p[k] + (p[(k) + 1] > 0 ? low : 0))
#define EACH _Pragma("GCC ivdep") for (int64_t i = 0; i < m; i++)

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define WIDEST __attribute__((target_clones("avx2", "default"))) /* the same bits, four at a time */
#else
#define WIDEST
#endif

/* One vector instruction on rows low … low + m - 1; returns its length. */
WIDEST static int lmoc_chunk(const int32_t *p, double *w, const int32_t *index, int64_t low, int64_t m) {
  double *out = w + p[1] + (p[2] > 0 ? low : 0);
  switch (p[0]) {
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3); \
      EACH { const double x = a[i]; out[i] = value; } \
      return 5; \
    }
    LMOC_UNARY(X)
#undef X
#define X(name, value) \
    case LMOC_##name: { \
      const double *a = PLACE(3), *b = PLACE(5); \
      if (p[4] < 0) { const double x = *a; EACH { const double y = b[i]; out[i] = value; } } \
      else if (p[6] < 0) { const double y = *b; EACH { const double x = a[i]; out[i] = value; } } \
      else EACH { const double x = a[i], y = b[i]; out[i] = value; } \
      return 7; \
    }
    LMOC_BINARY(X)
#undef X
    case LMOC_if: {
      const double *c = PLACE(3), *a = PLACE(5), *b = PLACE(7);
      const int64_t one = p[4] >= 0, two = p[6] >= 0, three = p[8] >= 0;
      for (int64_t i = 0; i < m; i++) out[i] = c[i*one] != 0 ? a[i*two] : b[i*three];
      return 9;
    }
    case LMOC_gather: {
      const int32_t *from = index + p[3] + low;
      EACH out[i] = w[from[i]];
      return 4;
    }
    case LMOC_strided: {
      const double *from = w + p[3] + low*p[4];
      const int64_t stride = p[4];
      EACH out[i] = from[i*stride];
      return 5;
    }
    case LMOC_scatter: {
      const int32_t *to = index + p[3] + low;
      const double *a = out;
      EACH w[to[i]] = a[i];
      return 4;
    }
    case LMOC_spread: {
      double *to = w + p[3] + low*p[4];
      const int64_t stride = p[4];
      const double *a = out;
      EACH to[i*stride] = a[i];
      return 5;
    }
  }
  return 1 << 30;
}

static void lmoc_rows(const int32_t *p, double *w, const int32_t *index) {
  const int64_t n = p[1];
  const int32_t *end = p + p[2];
  for (int64_t low = 0; low < n; low += LMOC_CHUNK) {
    const int64_t m = n - low < LMOC_CHUNK ? n - low : LMOC_CHUNK;
    for (const int32_t *q = p + 3; q < end; q += lmoc_chunk(q, w, index, low, m)) {}
  }
}

/* w[out[k]] = sum of w[factor[j]]*w[source[j]] over the j of segment k. A negative table counts places from there on, and
   there may be neither factors nor segments of more than one. */
static void lmoc_products(const int32_t *p, double *w, const int32_t *index) {
  const int64_t n = p[1];
  const int32_t *out = index + p[2], *source = index + p[5];
  const int32_t *start = p[3] < 0 ? 0 : index + p[3], *factor = p[4] < 0 ? 0 : index + p[4];
  if (!start) {
    for (int64_t k = 0; k < n; k++) w[out[k]] = w[factor[k]] * w[source[k]];
    return;
  }
  if (!factor) {
    for (int64_t k = 0; k < n; k++) {
      double s = 0;
      for (int32_t j = start[k]; j < start[k + 1]; j++) s += w[source[j]];
      w[out[k]] = s;
    }
    return;
  }
  for (int64_t k = 0; k < n; k++) {
    double s = 0;
    for (int32_t j = start[k]; j < start[k + 1]; j++) s += w[factor[j]] * w[source[j]];
    w[out[k]] = s;
  }
}

#if defined(__GNUC__)
#define NEXT goto *go[*p]
#define CASE(name) do_##name
#else
#define NEXT continue
#define CASE(name) case LMOC_##name
#endif

int lmoc_tape_run(double time, double *w, const lmoc_tape *t) {
#if defined(__GNUC__)
  static const void *const go[] = {
    &&do_end,
#define X(name, ...) &&do_##name,
    LMOC_UNARY(X) LMOC_BINARY(X) LMOC_OTHER(X)
#undef X
  };
#endif
  const int32_t *p = t->code;
  int status = 0;
  w[t->time] = time;
#if defined(__GNUC__)
  NEXT;
#else
  for (;;) switch (*p) {
#endif
#define X(name, value) CASE(name): { const double x = w[p[2]]; w[p[1]] = value; p += 3; NEXT; }
  LMOC_UNARY(X)
#undef X
#define X(name, value) CASE(name): { const double x = w[p[2]], y = w[p[3]]; w[p[1]] = value; p += 4; NEXT; }
  LMOC_BINARY(X)
#undef X
  CASE(if): w[p[1]] = w[p[2]] != 0 ? w[p[3]] : w[p[4]]; p += 5; NEXT;
  CASE(dot): {
    const int32_t *end = p + 3 + 2*p[2];
    double s = w[p[3]] * w[p[4]];
    for (const int32_t *q = p + 5; q < end; q += 2) s += w[q[0]] * w[q[1]];
    w[p[1]] = s;
    p = end;
    NEXT;
  }
  CASE(rows): lmoc_rows(p, w, t->index); p += p[2]; NEXT;
  CASE(products): lmoc_products(p, w, t->index); p += 6; NEXT;
  CASE(fill): {
    const double value = w[p[3]];
    const int32_t *out = t->index + p[2];
    for (int64_t k = 0; k < p[1]; k++) w[out[k]] = value;
    p += 4;
    NEXT;
  }
  CASE(linear): lmoc_block_functions.linear(t->blocks + p[1], w); p += 2; NEXT;
  CASE(newton): lmoc_block_functions.newton_begin(t->blocks + p[1], w); p += 2; NEXT;
  CASE(correct): {
    const int64_t open = lmoc_block_functions.newton_step(t->blocks + p[1], w);
    if (open > 0) p = t->code + p[2];
    else {
      status |= lmoc_block_functions.newton_end(t->blocks + p[1], w, open);
      p += 3;
    }
    NEXT;
  }
  CASE(ready): p = t->blocks[p[1]].ready ? t->code + p[2] : p + 3; NEXT;
  CASE(constant): lmoc_block_functions.constant(t->blocks + p[1], w); p += 2; NEXT;
  CASE(implicit): lmoc_block_functions.implicit(t->blocks + p[1], w); p += 2; NEXT;
  CASE(factor): status |= lmoc_block_functions.factor(t->blocks + p[1], w); p += 2; NEXT;
  CASE(gather): CASE(strided): CASE(scatter): CASE(spread): /* only inside of rows */
  CASE(end): return status;
#if !defined(__GNUC__)
  }
#endif
}

/* The names of the operations in the order of their numbers. */
const char *lmoc_operations(void) {
  return "end"
#define X(name, ...) " " #name
    LMOC_UNARY(X) LMOC_BINARY(X) LMOC_OTHER(X)
#undef X
    ;
}
