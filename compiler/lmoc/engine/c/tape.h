/* A program as a tape: instructions over one vector of doubles, in which registers, constants and scratch have their
   places. `lower/tape.py` describes the instructions, in the order of the lists below. */

#ifndef LMOC_TAPE_H
#define LMOC_TAPE_H

#include "lane.h"
#include "lu.h"

enum { LMOC_FAILED = 1, LMOC_FAR = 2 }; /* a block has no solution that was found; or none near the last one */

/* unlike fmin and fmax these do not drop an argument that is not a number */
static inline double lmoc_min(double x, double y) { return x < y || x != x ? x : y; }
static inline double lmoc_max(double x, double y) { return x > y || x != x ? x : y; }
static inline double lmoc_sign(double x) { return x != x ? x : (x > 0) - (x < 0); }
static inline double lmoc_mod(double x, double y) { return x - floor(x / y) * y; }
static inline double lmoc_quotient(double x, double y) { return trunc(x / y); }
static inline double lmoc_word(double x) { return floor(x) - floor(floor(x) / 4294967296.0) * 4294967296.0; }
static inline double lmoc_xor(double x, double y) {
  double a = lmoc_word(x), b = lmoc_word(y);
  return a == a && b == b ? (double)((uint32_t)a ^ (uint32_t)b) : a + b;
}
static inline double lmoc_rem(double x, double y) { return x - trunc(x / y) * y; }

/* The first of each are written for rows of lanes, too. */
#define LMOC_UNARY_OF_ROWS(X) X(move, x) X(neg, -x)
#define LMOC_BINARY_OF_ROWS(X) X(add, x + y) X(sub, x - y) X(mul, x * y) X(div, x / y)
#define LMOC_UNARY_OF_ONE(X) \
  X(sqrt, sqrt(x)) X(sin, sin(x)) X(cos, cos(x)) X(tan, tan(x)) X(asin, asin(x)) \
  X(acos, acos(x)) X(atan, atan(x)) X(sinh, sinh(x)) X(cosh, cosh(x)) X(tanh, tanh(x)) X(asinh, asinh(x)) \
  X(acosh, acosh(x)) X(atanh, atanh(x)) X(exp, exp(x)) X(log, log(x)) X(log10, log10(x)) X(abs, fabs(x)) \
  X(sign, lmoc_sign(x)) X(floor, floor(x)) X(ceil, ceil(x)) X(integer, floor(x)) X(not, !x)
#define LMOC_BINARY_OF_ONE(X) \
  X(pow, pow(x, y)) X(atan2, atan2(x, y)) \
  X(min, lmoc_min(x, y)) X(max, lmoc_max(x, y)) X(mod, lmoc_mod(x, y)) X(rem, lmoc_rem(x, y)) \
  X(div_integer, lmoc_quotient(x, y)) X(xor, lmoc_xor(x, y)) X(lt, x < y) X(le, x <= y) X(gt, x > y) \
  X(ge, x >= y) X(eq, x == y) X(ne, x != y) X(and, x && y) X(or, x || y)
#define LMOC_UNARY(X) LMOC_UNARY_OF_ROWS(X) LMOC_UNARY_OF_ONE(X)
#define LMOC_BINARY(X) LMOC_BINARY_OF_ROWS(X) LMOC_BINARY_OF_ONE(X)
#define LMOC_OTHER(X) \
  X(if) X(dot) X(rows) X(gather) X(strided) X(scatter) X(spread) X(products) X(fill) X(linear) X(newton) X(correct) \
  X(ready) X(constant) X(implicit) X(factor)

enum {
  LMOC_end,
#define X(name, ...) LMOC_##name,
  LMOC_UNARY(X) LMOC_BINARY(X) LMOC_OTHER(X)
#undef X
  LMOC_OPERATIONS
};

#define LMOC_CHUNK 256 /* rows that are worked on at once: a dozen buffers of them stay in the cache next to the core */

/* Implicit equations: `unknowns` such that `residuals` vanish, each instance on its own. All indices are places. */
typedef struct {
  int64_t instances, size, each, width; /* `each` entries of a matrix; `width` right sides of derivatives */
  const int32_t *unknowns, *residuals;  /* (instances, size) */
  const int32_t *fill;                  /* (instances, each) where the entries of the matrices stand */
  const int32_t *right;                 /* (instances, width, size) where those of the right sides stand */
  const int32_t *start, *rows;          /* the pattern of a sparse matrix by columns; 0: dense, row by row */
  int32_t *pivots;
  lmoc_lu *lu;
  int64_t a, b, work, x;                /* scratch: entries; one right side; what Newton's method keeps; solutions */
  int64_t ready, iteration;
  int64_t patient;                      /* the rules of Newton's method (`newton.c`) */
} lmoc_block;

typedef struct lmoc_tape lmoc_tape;

/* The functions of blocks, by which compiled code reaches the engine. */
typedef struct {
  void (*linear)(lmoc_block *, double *w);
  void (*newton_begin)(lmoc_block *, double *w);
  int64_t (*newton_step)(lmoc_block *, double *w);
  int (*newton_end)(lmoc_block *, double *w, int64_t open);
  void (*constant)(lmoc_block *, double *w);
  void (*implicit)(lmoc_block *, double *w);
  int (*factor)(lmoc_block *, double *w);
  int (*rows)(const int32_t *p, double *w, const lmoc_tape *t);
} lmoc_blocks;

struct lmoc_tape {
  int (*run)(lmoc_times time, double *w, const lmoc_tape *t);
  const int32_t *code;
  const int32_t *index; /* tables of places */
  lmoc_block *blocks;
  const lmoc_blocks *functions;
  int64_t time;         /* its place */
};

extern const lmoc_blocks LMOC_NAME(lmoc_block_functions);

/* Run the instructions. Returns 0 or LMOC_FAILED, LMOC_FAR; of lanes, which have no nonlinear blocks, a bit for each that
   has failed. */
int LMOC_NAME(lmoc_tape_run)(lmoc_times time, double *w, const lmoc_tape *t);

/* The same of one loop over rows. */
int LMOC_NAME(lmoc_rows)(const int32_t *p, double *w, const lmoc_tape *t);

#endif
