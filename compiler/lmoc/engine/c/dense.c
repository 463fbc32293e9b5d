/* Dense matrices: LU with row pivoting, and singular values for those that are singular. */

#include "dense.h"

#include <math.h>
#include <string.h>

enum { SWEEPS = 60 };  /* fewer than ten are needed */
static const double ORTHOGONAL = 1e-15;

/* Zeros are skipped: most matrices here are of things in a row. */
static inline void take_away(double *from, double f, const double *row, int64_t width) {
  if (width == 1) from[0] -= f * row[0];
  else if (f != 0) for (int64_t j = 0; j < width; j++) from[j] -= f * row[j];
}

int lmoc_dense_factor(int64_t n, double *a, int32_t *pivots, double *determinant) {
  double det = 1;
  int good = 1;
  for (int64_t k = 0; k < n; k++) {
    int64_t pivot = k;
    for (int64_t i = k + 1; i < n; i++)
      if (fabs(a[i*n + k]) > fabs(a[pivot*n + k])) pivot = i;
    pivots[k] = (int32_t)pivot;
    if (pivot != k) {
      det = -det;
      for (int64_t j = 0; j < n; j++) {
        const double t = a[k*n + j];
        a[k*n + j] = a[pivot*n + j];
        a[pivot*n + j] = t;
      }
    }
    const double own = a[k*n + k];
    det *= own;
    good &= own != 0 && own * 0 == 0;
    for (int64_t i = k + 1; i < n; i++) {
      const double f = a[i*n + k] /= own;
      take_away(a + i*n + k + 1, f, a + k*n + k + 1, n - k - 1);
    }
  }
  *determinant = det;
  return good;
}

void lmoc_dense_substitute(int64_t n, const double *a, const int32_t *pivots, int64_t width, double *b) {
  for (int64_t k = 0; k < n; k++)
    for (int64_t j = 0; j < width && pivots[k] != k; j++) {
      const double t = b[pivots[k]*width + j];
      b[pivots[k]*width + j] = b[k*width + j];
      b[k*width + j] = t;
    }
  for (int64_t k = 0; k < n; k++)
    for (int64_t j = 0; j < k; j++) take_away(b + k*width, a[k*n + j], b + j*width, width);
  for (int64_t k = n - 1; k >= 0; k--) {
    for (int64_t j = k + 1; j < n; j++) take_away(b + k*width, a[k*n + j], b + j*width, width);
    for (int64_t j = 0; j < width; j++) b[k*width + j] /= a[k*n + k];
  }
}

/* The largest sum of a column. */
static double norm(int64_t n, const double *a) {
  double most = 0;
  for (int64_t j = 0; j < n; j++) {
    double sum = 0;
    for (int64_t i = 0; i < n; i++) sum += fabs(a[i*n + j]);
    most = sum > most || sum != sum ? sum : most;
  }
  return most;
}

int lmoc_dense_inverse(int64_t n, double *a, int32_t *pivots, double worst, double *inverse) {
  const double size = norm(n, a);
  double determinant;
  if (!lmoc_dense_factor(n, a, pivots, &determinant)) return 0;
  memset(inverse, 0, n * n * sizeof(double));
  for (int64_t k = 0; k < n; k++) inverse[k*n + k] = 1;
  lmoc_dense_substitute(n, a, pivots, n, inverse);
  return size * norm(n, inverse) < worst;
}

void lmoc_dense_eliminate(int64_t rows, int64_t width, double *table, int64_t row, int64_t column) {
  double *own = table + row*width;
  const double pivot = own[column];
  for (int64_t j = 0; j < width; j++) own[j] /= pivot;
  for (int64_t i = 0; i < rows; i++) {
    const double f = table[i*width + column];
    if (i != row && f != 0) for (int64_t j = 0; j < width; j++) table[i*width + j] -= f * own[j];
  }
}

static void rotate(int64_t m, int64_t n, double *a, int64_t p, int64_t q, double cosine, double sine) {
  for (int64_t i = 0; i < m; i++) {
    const double kept = a[i*n + p];
    a[i*n + p] = cosine * kept - sine * a[i*n + q];
    a[i*n + q] = sine * kept + cosine * a[i*n + q];
  }
}

/* By rotations of columns (M. R. Hestenes, Inversion of matrices by biorthogonalization, J. SIAM 6, 1958). */
void lmoc_singular_values(int64_t m, int64_t n, double *u, double *v, double *values) {
  int turning = 1;
  if (v) memset(v, 0, n * n * sizeof(double));
  for (int64_t k = 0; v && k < n; k++) v[k*n + k] = 1;
  for (int sweep = 0; turning && sweep < SWEEPS; sweep++) {
    turning = 0;
    for (int64_t p = 0; p < n; p++)
      for (int64_t q = p + 1; q < n; q++) {
        double a = 0, b = 0, c = 0;
        for (int64_t i = 0; i < m; i++) {
          a += u[i*n + p] * u[i*n + p];
          b += u[i*n + q] * u[i*n + q];
          c += u[i*n + p] * u[i*n + q];
        }
        if (!(fabs(c) > ORTHOGONAL * sqrt(a * b))) continue;
        turning = 1;
        const double zeta = (b - a) / (2 * c), t = (zeta < 0 ? -1 : 1) / (fabs(zeta) + hypot(1, zeta));
        const double cosine = 1 / hypot(1, t);
        rotate(m, n, u, p, q, cosine, cosine * t);
        if (v) rotate(n, n, v, p, q, cosine, cosine * t);
      }
  }
  for (int64_t j = 0; j < n; j++) {
    double sum = 0;
    for (int64_t i = 0; i < m; i++) sum += u[i*n + j] * u[i*n + j];
    values[j] = sqrt(sum);
  }
}

void lmoc_least_squares(int64_t n, const double *u, const double *v, const double *values, double share,
                        const double *b, double *x) {
  double most = 0;
  for (int64_t j = 0; j < n; j++) most = fmax(most, values[j]);
  for (int64_t i = 0; i < n; i++) x[i] = 0;
  for (int64_t j = 0; j < n; j++) {
    if (!(values[j] > share * most)) continue;
    double along = 0;
    for (int64_t i = 0; i < n; i++) along += u[i*n + j] * b[i];
    along /= values[j] * values[j];
    for (int64_t i = 0; i < n; i++) x[i] += v[i*n + j] * along;
  }
}
