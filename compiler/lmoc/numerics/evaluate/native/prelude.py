"""C functions that generated programs call."""

PRELUDE = r"""
#include <math.h>
#include <stdint.h>
#include <string.h>

/* unlike fmin and fmax these do not drop an argument that is not a number */
static inline double lmoc_min(double x, double y) { return x < y || x != x ? x : y; }
static inline double lmoc_max(double x, double y) { return x > y || x != x ? x : y; }
static inline double lmoc_sign(double x) { return x != x ? x : (x > 0) - (x < 0); }
static inline double lmoc_mod(double x, double y) { return x - floor(x / y) * y; }
static inline double lmoc_quotient(double x, double y) { return trunc(x / y); }
static inline double lmoc_rem(double x, double y) { return x - trunc(x / y) * y; }

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

static void lmoc_derivatives(const lmoc_call *c, double time, const double *x, double *f) {
  if (c->first_state >= 0) memcpy(c->w + c->first_state, x, c->n * sizeof(double));
  else for (int64_t i = 0; i < c->n; i++) c->w[c->states[i]] = x[i];
  lmoc_program(time, c->w, c->m, c->tab);
  for (int64_t i = 0; i < c->n; i++) f[i] = c->w[c->derivatives[i]];
}

/* out = x + h*sum_j a[j]*k[j] over the stages with a coefficient, in pieces that stay in the cache */
static void lmoc_stage(int64_t n, int stages, const double *a, double h, const double *x, const double *k,
                       double *out) {
  for (int64_t low = 0; low < n; low += 1024) {
    const int64_t high = low + 1024 < n ? low + 1024 : n;
    for (int64_t i = low; i < high; i++) out[i] = 0;
    for (int j = 0; j < stages; j++) {
      const double b = a[j], *kj = k + j*n;
      if (b != 0) for (int64_t i = low; i < high; i++) out[i] += b * kj[i];
    }
    for (int64_t i = low; i < high; i++) out[i] = x[i] + h * out[i];
  }
}

/* One step of DOP853 from (time, x) with k[0] = f: the new state, the error, |h*lambda|.
   Rows of `a`: the 16 stages, then B, E5, E3. */
void lmoc_dop853_attempt(const lmoc_call *c, double time, double h, double rtol, const double *a, const double *times,
                         const double *x, const double *atol, double *k, double *x_new, double *last,
                         double *result) {
  const int64_t n = c->n;
  for (int s = 1; s < 12; s++) {
    lmoc_stage(n, s, a + 16*s, h, x, k, last);
    lmoc_derivatives(c, time + times[s]*h, last, k + s*n);
  }
  lmoc_stage(n, 12, a + 16*16, h, x, k, x_new);
  lmoc_derivatives(c, time + h, x_new, k + 12*n);
  const double *w5 = a + 16*17, *w3 = a + 16*18;
  double e5 = 0, e3 = 0, change = 0, rise = 0, poison = 0;
  for (int64_t i = 0; i < n; i++) {
    double s5 = 0, s3 = 0;
    for (int j = 0; j < 13; j++) { s5 += w5[j]*k[j*n + i]; s3 += w3[j]*k[j*n + i]; }
    const double scale = atol[i] + rtol*fmax(fabs(x[i]), fabs(x_new[i]));
    e5 += (s5/scale)*(s5/scale);
    e3 += (s3/scale)*(s3/scale);
    const double dx = x_new[i] - last[i], df = k[12*n + i] - k[11*n + i];
    change += dx*dx;
    rise += df*df;
    poison += 0*k[12*n + i];  /* the error weights alone may hide a NaN at the end of the step */
  }
  result[0] = h*e5/sqrt((e5 + 0.01*e3 + 1e-300)*n) + poison;
  result[1] = change > 0 ? h*sqrt(rise/change) : 0;
}

/* The three further stages that dense output needs. */
void lmoc_dop853_more(const lmoc_call *c, double time, double h, const double *a, const double *times, const double *x,
                      double *k, double *work) {
  for (int s = 13; s < 16; s++) {
    lmoc_stage(c->n, s, a + 16*s, h, x, k, work);
    lmoc_derivatives(c, time + times[s]*h, work, k + s*c->n);
  }
}
"""
