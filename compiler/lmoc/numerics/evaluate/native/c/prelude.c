/* Functions that every generated program may call. */

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { LMOC_FAILED = 1, LMOC_FAR = 2 }; /* a block has no solution that was found; or none near the last one */

/* unlike fmin and fmax these do not drop an argument that is not a number */
static inline double lmoc_min(double x, double y) { return x < y || x != x ? x : y; }
static inline double lmoc_max(double x, double y) { return x > y || x != x ? x : y; }
static inline double lmoc_sign(double x) { return x != x ? x : (x > 0) - (x < 0); }
static inline double lmoc_mod(double x, double y) { return x - floor(x / y) * y; }
static inline double lmoc_quotient(double x, double y) { return trunc(x / y); }
static inline double lmoc_rem(double x, double y) { return x - trunc(x / y) * y; }

/* Solve Pr A Pc = L U with factors by columns, unit diagonal in L first in its column, diagonal of U last. */
static void lmoc_sparse_solve(int64_t n, double *b, double *y, const void *ls, const void *li, const void *lv,
                              const void *us, const void *ui, const void *uv, const void *pr, const void *pc) {
  const int32_t *l_start = ls, *l_index = li, *u_start = us, *u_index = ui, *row = pr, *column = pc;
  const double *l_value = lv, *u_value = uv;
  for (int64_t i = 0; i < n; i++) y[row[i]] = b[i];
  for (int64_t j = 0; j < n; j++) {
    const double x = y[j];
    for (int32_t k = l_start[j] + 1; k < l_start[j + 1]; k++) y[l_index[k]] -= l_value[k] * x;
  }
  for (int64_t j = n - 1; j >= 0; j--) {
    const int32_t last = u_start[j + 1] - 1;
    const double x = y[j] /= u_value[last];
    for (int32_t k = u_start[j]; k < last; k++) y[u_index[k]] -= u_value[k] * x;
  }
  for (int64_t i = 0; i < n; i++) b[i] = y[column[i]];
}
