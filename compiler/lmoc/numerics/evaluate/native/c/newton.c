/* Newton's method for many instances of one nonlinear block. LMOC_RATE, LMOC_ITERATIONS and LMOC_NEAR are defined before. */

#define LMOC_EXACT 1e-13   /* of the size of the unknowns: no correction is smaller in double precision */
#define LMOC_SQUARED 1e-9  /* of their size: a correction whose square is below rounding, where the constant of quadratic … */
#define LMOC_CURVED 10     /* … convergence is no larger, in sizes of the unknowns */
#define LMOC_LOOSE 1e-8    /* good enough where the corrections do not shrink any more */
#define LMOC_ROUNDING 1e-15 /* of the terms of an equation: what their sum may miss zero by */

/* Whether what is left behind a correction is below rounding: corrections shrink as the square of the one before, times
   a constant that these two tell (Deuflhard, section 2.1). Near a singular place, where it is large, none is left out. */
static inline int lmoc_newton_arrived(double length, double before, double size) {
  if (length <= LMOC_EXACT * size) return 1;
  return before < INFINITY && length <= LMOC_SQUARED * size && length * size <= LMOC_CURVED * before * before;
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
    s->before[i] = lmoc_newton_arrived(length, before, size) ? -1 : length;
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
