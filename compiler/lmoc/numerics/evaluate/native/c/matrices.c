/* Matrices of implicit blocks: LU factors, dense with row pivoting, or sparse on a fixed pattern and order of pivots. */

#define LMOC_WEAK 1e-3     /* of its column: a pivot below is reselected */

/* The factors L U of a sparse matrix by columns in the order of the pivots, as pivots.Factors lays them out. */
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

/* The same as below for two rows: the closure of a loop in the plane. */
static inline int lmoc_pair_factor(double *a, int *pivots, double *determinant) {
  const int lower = fabs(a[2]) > fabs(a[0]);
  const double p = lower ? a[2] : a[0], q = lower ? a[3] : a[1], r = lower ? a[0] : a[2], s = lower ? a[1] : a[3];
  pivots[0] = lower;
  pivots[1] = 1;
  a[0] = p;
  a[1] = q;
  a[2] = r / p;
  a[3] = s - a[2]*q;
  *determinant = (lower ? -p : p) * a[3];
  return p != 0 && p * 0 == 0 && a[3] != 0 && a[3] * 0 == 0;
}

static inline void lmoc_pair_substitute(const double *a, const int *pivots, double *b) {
  const double first = b[pivots[0]], second = b[1 - pivots[0]] - a[2]*first;
  b[1] = second / a[3];
  b[0] = (first - a[1]*b[1]) / a[0];
}

/* LU with row pivoting in place, `size` rows; 0 where a pivot is zero or no number. */
static inline int lmoc_dense_factor(int64_t size, double *a, int *pivots, double *determinant) {
  if (size == 2) return lmoc_pair_factor(a, pivots, determinant);
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
  if (size == 2) {
    lmoc_pair_substitute(a, pivots, b);
    return;
  }
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
