"""C functions that generated programs call."""

PRELUDE = r"""
#include <math.h>
#include <stdint.h>
#include <string.h>

static inline double lmoc_sign(double x) { return (x > 0) - (x < 0); }
static inline double lmoc_mod(double x, double y) { return x - floor(x / y) * y; }
static inline double lmoc_quotient(double x, double y) { return trunc(x / y); }

/* Gauss elimination with row pivoting on size rows of size + 1 numbers; the last column becomes the solution. */
static void lmoc_dense_solve(int size, double *a) {
  const int width = size + 1;
  for (int k = 0; k < size; k++) {
    int pivot = k;
    for (int i = k + 1; i < size; i++)
      if (fabs(a[i*width + k]) > fabs(a[pivot*width + k])) pivot = i;
    if (pivot != k)
      for (int j = k; j < width; j++) {
        const double t = a[k*width + j];
        a[k*width + j] = a[pivot*width + j];
        a[pivot*width + j] = t;
      }
    for (int i = k + 1; i < size; i++) {
      const double f = a[i*width + k] / a[k*width + k];
      for (int j = k + 1; j < width; j++) a[i*width + j] -= f * a[k*width + j];
    }
  }
  for (int i = size - 1; i >= 0; i--) {
    double s = a[i*width + size];
    for (int j = i + 1; j < size; j++) s -= a[i*width + j] * a[j*width + size];
    a[i*width + size] = s / a[i*width + i];
  }
}

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
"""

# The right-hand side in the form that SUNDIALS calls: states into the registers, the program, derivatives out of them.
CALLBACK = r"""
typedef struct {
  double *w;
  const int64_t *m;
  const void *const *tab;
  int64_t n, first_state;
  const int32_t *states, *derivatives;
  double *(*data)(void *);
} lmoc_call;

int lmoc_rhs(double time, void *y, void *ydot, void *user) {
  const lmoc_call *c = user;
  const double *x = c->data(y);
  double *f = c->data(ydot);
  double check = 0;
  if (c->first_state >= 0) memcpy(c->w + c->first_state, x, c->n * sizeof(double));
  else for (int64_t i = 0; i < c->n; i++) c->w[c->states[i]] = x[i];
  lmoc_program(time, c->w, c->m, c->tab);
  for (int64_t i = 0; i < c->n; i++) { f[i] = c->w[c->derivatives[i]]; check += f[i] * 0.0; }
  return check == 0 ? 0 : 1;  /* NaN or infinity: a step that CVODE tries again, smaller */
}
"""
