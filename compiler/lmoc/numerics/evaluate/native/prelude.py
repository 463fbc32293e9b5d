"""C functions that generated programs call."""

PRELUDE = r"""
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
"""

# Matrices of blocks, and Newton's method.
BLOCKS = r"""
#define LMOC_EXACT 1e-13   /* of the size of the unknowns: no correction is smaller in double precision */
#define LMOC_LOOSE 1e-8    /* good enough where the corrections do not shrink any more */
#define LMOC_ROUNDING 1e-15 /* of the terms of an equation: what their sum may miss zero by */
#define LMOC_WEAK 1e-3     /* of its column: a pivot below is reselected */

/* The factors L U of a sparse matrix by columns in the order of the pivots, as native.pivots.Factors lays them out. */
typedef struct {
  int64_t n, ready, number;
  const int32_t *a_start, *a_place, *a_source, *u_start, *u_place, *l_start, *l_place, *row, *column;
  double *u, *l, *d, *x;
} lmoc_factors;

typedef int (*lmoc_choose)(int64_t number, const double *values);

/* The matrix of a block: row by row where `start` is 0, else by columns. */
typedef struct {
  int64_t size, each;
  const int32_t *start, *rows;
  lmoc_factors *factors;
  lmoc_choose choose;
} lmoc_matrix;

/* Factorize on the given pattern and order of pivots; 0 where a pivot is too small beside its column. */
static int lmoc_refactor(const lmoc_factors *f, const double *values, double *det) {
  double *x = f->x, product = 1;
  for (int64_t k = 0; k < f->n; k++) {
    for (int32_t e = f->a_start[k]; e < f->a_start[k + 1]; e++) x[f->a_place[e]] += values[f->a_source[e]];
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++) {
      const int32_t j = f->u_place[e];
      const double y = x[j];
      f->u[e] = y;
      x[j] = 0;
      if (y != 0)
        for (int32_t g = f->l_start[j]; g < f->l_start[j + 1]; g++) x[f->l_place[g]] -= f->l[g] * y;
    }
    const double d = x[k];
    double largest = fabs(d);
    x[k] = 0;
    for (int32_t g = f->l_start[k]; g < f->l_start[k + 1]; g++) {
      largest = lmoc_max(largest, fabs(x[f->l_place[g]]));
      f->l[g] = x[f->l_place[g]] / d;
      x[f->l_place[g]] = 0;
    }
    f->d[k] = d;
    product *= d;
    if (!(fabs(d) >= LMOC_WEAK * largest) || d == 0) return 0;
  }
  *det = product;
  return 1;
}

static void lmoc_substitute(const lmoc_factors *f, double *b) {
  double *y = f->x + f->n;
  for (int64_t k = 0; k < f->n; k++) y[k] = b[f->row[k]];
  for (int64_t k = 0; k < f->n; k++) {
    const double v = y[k];
    if (v != 0)
      for (int32_t g = f->l_start[k]; g < f->l_start[k + 1]; g++) y[f->l_place[g]] -= f->l[g] * v;
  }
  for (int64_t k = f->n - 1; k >= 0; k--) {
    const double v = y[k] / f->d[k];
    b[f->column[k]] = v;
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++) y[f->u_place[e]] -= f->u[e] * v;
  }
}

/* LU with row pivoting in place, `size` rows; 0 where a pivot is zero or no number. */
static inline int lmoc_dense_factor(int64_t size, double *a, int *pivots, double *determinant) {
  double det = 1;
  int good = 1;
  for (int64_t k = 0; k < size; k++) {
    int64_t pivot = k;
    for (int64_t i = k + 1; i < size; i++)
      if (fabs(a[i*size + k]) > fabs(a[pivot*size + k])) pivot = i;
    pivots[k] = (int)pivot;
    if (pivot != k) {
      det = -det;
      for (int64_t j = 0; j < size; j++) {
        const double t = a[k*size + j];
        a[k*size + j] = a[pivot*size + j];
        a[pivot*size + j] = t;
      }
    }
    const double own = a[k*size + k];
    det *= own;
    good &= own != 0 && own * 0 == 0;
    for (int64_t i = k + 1; i < size; i++) {
      const double f = a[i*size + k] /= own;
      for (int64_t j = k + 1; j < size; j++) a[i*size + j] -= f * a[k*size + j];
    }
  }
  *determinant = det;
  return good;
}

static inline void lmoc_dense_substitute(int64_t size, const double *a, const int *pivots, double *b) {
  for (int64_t k = 0; k < size; k++) {
    const double t = b[pivots[k]];
    b[pivots[k]] = b[k];
    b[k] = t;
  }
  for (int64_t k = 0; k < size; k++)
    for (int64_t j = 0; j < k; j++) b[k] -= a[k*size + j] * b[j];
  for (int64_t k = size - 1; k >= 0; k--) {
    for (int64_t j = k + 1; j < size; j++) b[k] -= a[k*size + j] * b[j];
    b[k] /= a[k*size + k];
  }
}

/* Factorize the matrix of one instance; 0 where it is singular or has entries that are no numbers. */
static inline int lmoc_factor(const lmoc_matrix *m, double *a, int *pivots, double *det) {
  if (!m->start) return lmoc_dense_factor(m->size, a, pivots, det);
  if (m->factors->ready && lmoc_refactor(m->factors, a, det)) return 1;
  memset(m->factors->x, 0, m->factors->ready ? 2 * m->size * sizeof(double) : 0);
  double check = 0;
  for (int64_t k = 0; k < m->each; k++) check += a[k] * 0;
  *det = 0;
  if (check != 0 || !m->choose(m->factors->number, a)) return 0;
  return lmoc_refactor(m->factors, a, det);
}

static inline void lmoc_solve(const lmoc_matrix *m, const double *a, const int *pivots, double *b) {
  if (m->start) lmoc_substitute(m->factors, b);
  else lmoc_dense_substitute(m->size, a, pivots, b);
}

/* Unknowns of linear blocks from their residuals at zero; no numbers where the matrix is singular. */
static inline void lmoc_linear(const lmoc_matrix *m, int64_t n, double *a, double *w, const int32_t *u,
                              const int32_t *r, double *b) {
  int pivots[16];
  for (int64_t i = 0; i < n; i++, u += m->size, r += m->size, a += m->each) {
    double det;
    for (int64_t k = 0; k < m->size; k++) b[k] = -w[r[k]];
    const int good = lmoc_factor(m, a, pivots, &det);
    if (good) lmoc_solve(m, a, pivots, b);
    for (int64_t k = 0; k < m->size; k++) w[u[k]] = good ? b[k] : NAN;
  }
}

/* x := -A^-1 x for `width` columns of each instance. */
static inline void lmoc_implicit(const lmoc_matrix *m, int64_t n, double *a, double *x, int64_t width) {
  int pivots[16];
  for (int64_t i = 0; i < n; i++, a += m->each) {
    double det;
    const int good = lmoc_factor(m, a, pivots, &det);
    for (int64_t j = 0; j < width; j++, x += m->size) {
      if (good) lmoc_solve(m, a, pivots, x);
      for (int64_t k = 0; k < m->size; k++) x[k] = good ? -x[k] : NAN;
    }
  }
}

/* What Newton's method keeps of every instance: determinant, length of the last correction (-1: solved), where it
   began, and where the first step led. */
typedef struct { double *det, *before, *start, *target; } lmoc_newton;

static inline lmoc_newton lmoc_newton_work(double *work, int64_t n, int64_t size) {
  return (lmoc_newton){work, work + n, work + 2*n, work + 2*n + n*size};
}

static inline void lmoc_newton_begin(const lmoc_newton *s, int64_t total, const double *w, const int32_t *u) {
  for (int64_t k = 0; k < total; k++) s->start[k] = w[u[k]];
}

/* Whether the residuals vanish to rounding: the terms of row k are |a(k,j) u(j)|. */
static inline int lmoc_vanishes(const lmoc_matrix *m, const double *a, const double *w, const int32_t *u,
                                const int32_t *r, double *b) {
  for (int64_t k = 0; k < m->size; k++) b[k] = 0;
  if (m->start)
    for (int64_t j = 0; j < m->size; j++)
      for (int32_t e = m->start[j]; e < m->start[j + 1]; e++) b[m->rows[e]] += fabs(a[e] * w[u[j]]);
  else
    for (int64_t k = 0; k < m->size; k++)
      for (int64_t j = 0; j < m->size; j++) b[k] += fabs(a[k*m->size + j] * w[u[j]]);
  for (int64_t k = 0; k < m->size; k++)
    if (!(fabs(w[r[k]]) <= LMOC_ROUNDING * b[k])) return 0;
  return 1;
}

/* One correction of every instance that is not solved. Returns how many are left, or -1 where one does not converge.
   Corrections have to shrink by the factor LMOC_RATE; where they stop shrinking, rounding is reached or it fails. */
static inline int64_t lmoc_newton_step(const lmoc_newton *s, int iteration, const lmoc_matrix *m, int64_t n, double *a,
                                       double *w, const int32_t *u, const int32_t *r, double *b) {
  int64_t left = 0;
  int pivots[16];
  for (int64_t i = 0; i < n; i++, u += m->size, r += m->size, a += m->each) {
    if (iteration > 0 && s->before[i] < 0) continue;
    const double before = iteration ? s->before[i] : INFINITY;
    const int solved = lmoc_vanishes(m, a, w, u, r, b);
    double length = 0, size = 1;
    for (int64_t k = 0; k < m->size; k++) { b[k] = w[r[k]]; size = fmax(size, 1 + fabs(w[u[k]])); }
    const int good = lmoc_factor(m, a, pivots, &s->det[i]);
    if (good) lmoc_solve(m, a, pivots, b);
    for (int64_t k = 0; k < m->size; k++) length = lmoc_max(length, fabs(b[k]));
    if (!good) length = NAN;
    if (solved && !(length <= LMOC_RATE * before && length <= LMOC_LOOSE * size)) {
      for (int64_t k = 0; k < m->size; k++) b[k] = 0;
      length = 0;
    }
    if (!(length * 0 == 0)) return -1;
    if (iteration == 0)
      for (int64_t k = 0; k < m->size; k++) s->target[i*m->size + k] = w[u[k]] - b[k];
    if (iteration && length > LMOC_RATE * before) {
      if (length > LMOC_LOOSE * size) return -1;
      s->before[i] = -1;
      continue;
    }
    for (int64_t k = 0; k < m->size; k++) w[u[k]] -= b[k];
    s->before[i] = length <= LMOC_EXACT * size ? -1 : length;
    left += s->before[i] >= 0;
  }
  return left > 0 && iteration >= LMOC_ITERATIONS ? -1 : left;
}

/* FAILED, or FAR where a solution is not where the first step pointed, near the one before (Deuflhard, Newton Methods
   for Nonlinear Problems, 2004, section 5.1). */
static inline int lmoc_newton_end(const lmoc_newton *s, int64_t left, int64_t n, int64_t size, double *w,
                                  const int32_t *u) {
  if (left < 0) {
    for (int64_t k = 0; k < n*size; k++) w[u[k]] = NAN;
    return LMOC_FAILED;
  }
  for (int64_t i = 0; i < n; i++) {
    double missed = 0, way = 0, scale = 1;
    for (int64_t k = i*size; k < (i + 1)*size; k++) {
      const double x = w[u[k]], own = fabs(x - s->start[k]);
      missed = fmax(missed, fabs(x - s->target[k]));
      way = fmax(way, own);
      scale = fmax(scale, 1 + fabs(x));
      if (!(own <= 0.25 * (1 + fabs(x)))) return LMOC_FAR;
    }
    if (!(missed <= LMOC_NEAR * way + LMOC_LOOSE * scale)) return LMOC_FAR;
  }
  return 0;
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
  int64_t remembered, solved;   /* unknowns of nonlinear blocks; whether they have been solved before … */
  const int32_t *unknowns;
  double *solution, *x, time;   /* … and how, with which states, and when */
  int (*rescue)(double time);
  double marked_time;
  int64_t marked;               /* whether a solution has been marked; it stands behind the others */
} lmoc_call;

static void lmoc_given(lmoc_call *c, const double *x) {
  if (c->first_state >= 0) memcpy(c->w + c->first_state, x, c->n * sizeof(double));
  else for (int64_t i = 0; i < c->n; i++) c->w[c->states[i]] = x[i];
}

static void lmoc_restore(lmoc_call *c, const double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) c->w[c->unknowns[k]] = solution[k];
}

static void lmoc_remember(lmoc_call *c, double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) solution[k] = c->w[c->unknowns[k]];
}

/* Mark the last solution as one to go back to: that of an accepted step. */
void lmoc_mark(lmoc_call *c) {
  if (!c->solved) return;
  memcpy(c->solution + 2*c->remembered, c->solution, c->remembered * sizeof(double));
  memcpy(c->x + 2*c->n, c->x, c->n * sizeof(double));
  c->marked_time = c->time;
  c->marked = 1;
}

static void lmoc_go_back(lmoc_call *c) {
  memcpy(c->solution, c->solution + 2*c->remembered, c->remembered * sizeof(double));
  memcpy(c->x, c->x + 2*c->n, c->n * sizeof(double));
  c->time = c->marked_time;
}

/* The way from the last solution in shorter steps along the straight line between the states: continuation with step
   size control (Deuflhard, section 5.1). Returns 0 where it leads all the way; the solutions stand in the registers. */
static int lmoc_approach(lmoc_call *c, double time, const double *x) {
  double reached = 0, step = 0.5;
  double *near = c->solution + c->remembered, *between = c->x + c->n;
  memcpy(near, c->solution, c->remembered * sizeof(double));
  while (reached < 1 && step >= 0x1p-10) {
    const double goal = fmin(1, reached + step);
    for (int64_t i = 0; i < c->n; i++)
      between[i] = goal < 1 && x[i] != c->x[i] ? c->x[i] + goal*(x[i] - c->x[i]) : x[i];
    lmoc_restore(c, near);
    lmoc_given(c, between);
    if (lmoc_program(goal < 1 ? c->time + goal*(time - c->time) : time, c->w, c->m, c->tab)) step /= 2;
    else {
      lmoc_remember(c, near);
      reached = goal;
      step *= 2;
    }
  }
  lmoc_given(c, x);
  if (reached == 1) return 0;
  lmoc_restore(c, near);
  return LMOC_FAILED;
}

/* Run the program for some states. Nonlinear blocks start from their last solution and stay near it; where that is
   impossible, they have none, and keep the last one for the next time. */
int lmoc_evaluate(lmoc_call *c, double time, const double *x) {
  lmoc_given(c, x);
  if (!c->remembered) return lmoc_program(time, c->w, c->m, c->tab);
  if (c->solved) lmoc_restore(c, c->solution);
  int status = lmoc_program(time, c->w, c->m, c->tab);
  if (status && c->solved) status = lmoc_approach(c, time, x);
  if (status & LMOC_FAILED && c->solved && c->marked) {  /* the last one may stand at an attempt that led astray */
    lmoc_go_back(c);
    status = lmoc_approach(c, time, x);
  }
  if (status & LMOC_FAILED && c->rescue && c->rescue(time)) status = lmoc_program(time, c->w, c->m, c->tab);
  if (status & LMOC_FAILED) return status;
  lmoc_remember(c, c->solution);
  memcpy(c->x, x, c->n * sizeof(double));
  c->time = time;
  c->solved = 1;
  return 0;
}

/* For many times: states (count, n) in, some registers (count, chosen) out. */
void lmoc_many(lmoc_call *c, int64_t count, const double *times, const double *x, int64_t chosen,
               const int32_t *registers, double *out) {
  for (int64_t k = 0; k < count; k++, x += c->n, out += chosen) {
    const int failed = lmoc_evaluate(c, times[k], x);
    for (int64_t j = 0; j < chosen; j++) out[j] = c->w[registers[j]];
    if (failed && c->remembered) lmoc_restore(c, c->solution);
  }
}

int lmoc_rhs(double time, void *y, void *ydot, void *user) {
  lmoc_call *c = user;
  double *f = c->data(ydot);
  double check = 0;
  if (lmoc_evaluate(c, time, c->data(y))) return 1;
  for (int64_t i = 0; i < c->n; i++) { f[i] = c->w[c->derivatives[i]]; check += f[i] * 0.0; }
  return check == 0 ? 0 : 1;  /* NaN or infinity: a step that CVODE tries again, smaller */
}

static void lmoc_derivatives(lmoc_call *c, double time, const double *x, double *f) {
  const int failed = lmoc_evaluate(c, time, x);
  for (int64_t i = 0; i < c->n; i++) f[i] = failed ? NAN : c->w[c->derivatives[i]];
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
void lmoc_dop853_attempt(lmoc_call *c, double time, double h, double rtol, const double *a, const double *times,
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
void lmoc_dop853_more(lmoc_call *c, double time, double h, const double *a, const double *times, const double *x,
                      double *k, double *work) {
  for (int s = 13; s < 16; s++) {
    lmoc_stage(c->n, s, a + 16*s, h, x, k, work);
    lmoc_derivatives(c, time + times[s]*h, work, k + s*c->n);
  }
}
"""
