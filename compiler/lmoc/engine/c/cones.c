/* Complementarity problems with the friction of contacts, by Lemke's algorithm.

   The limits of a contact's friction are shares of its normal force, so that bounds follow from the answer. Iterating on
   them need not converge, however regular the problem. Lemke's algorithm finds an answer wherever the bodies are not
   caught between dependent laws (D. E. Stewart and J. C. Trinkle, An implicit time-stepping scheme for rigid body
   dynamics with inelastic collisions and Coulomb friction, Int. J. Numer. Methods Eng. 39, 1996; C. E. Lemke, Bimatrix
   equilibrium points and mathematical programming, Management Science 11, 1965): friction forward and backward (b+, b-)
   and the sliding speed s are unknowns of their own,

     0 <= fn _|_ rn >= 0,   0 <= b+- _|_ +-rt + s >= 0,   0 <= s _|_ mu fn - b+ - b- >= 0,   ft = b+ - b-.

   It works on a dense table and is slow beside block pivoting, so that it is asked only where that gives up. */

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "complementarity.h"
#include "dense.h"

static const double NO_ENTRY = 1e-12;  /* `numerics/limits.py` */
enum { MOST_PIVOTS = 50 };             /* a row of the table */

/* The row that leaves first; the artificial one where it can, and ties by the inverse of the basis. */
static int64_t least_ratio(const double *table, int64_t n, int64_t entering, int64_t *able, int64_t count,
                           const int64_t *basis) {
  const int64_t width = 2*n + 2;
  for (int64_t column = -1; column < n; column++) {
    const int64_t own = column < 0 ? width - 1 : column;
    double least = INFINITY, most = 0;
    for (int64_t i = 0; i < count; i++) {
      const double ratio = table[able[i]*width + own] / table[able[i]*width + entering];
      least = fmin(least, ratio);
      most = fmax(most, fabs(ratio));
    }
    int64_t left = 0;
    for (int64_t i = 0; i < count; i++) {
      const double ratio = table[able[i]*width + own] / table[able[i]*width + entering];
      if (!(ratio <= least + NO_ENTRY * most)) continue;
      if (basis[able[i]] == 2*n) return able[i];
      able[left++] = able[i];
    }
    if ((count = left) <= 1) break;
  }
  return able[0];
}

/* Rows that an entering column pushes towards zero. */
static int64_t those_able(const double *table, int64_t n, int64_t entering, int64_t *able) {
  const int64_t width = 2*n + 2;
  double most = 0;
  int64_t count = 0;
  for (int64_t i = 0; i < n; i++) most = fmax(most, fabs(table[i*width + entering]));
  for (int64_t i = 0; i < n; i++)
    if (table[i*width + entering] > NO_ENTRY * most) able[count++] = i;
  return count;
}

/* w/scale - (matrix/scale) z - z0 = q/scale; columns: w, z, z0, right side. Ties are broken lexicographically. */
static int pivots(double *table, int64_t n, int64_t *basis, int64_t *able) {
  const int64_t width = 2*n + 2;
  int64_t row = 0, entering = 2*n;
  for (int64_t i = 1; i < n; i++)
    if (table[i*width + width - 1] < table[row*width + width - 1]) row = i;
  for (int64_t step = 0; step < MOST_PIVOTS*n; step++) {
    const int64_t leaving = basis[row];
    lmoc_dense_eliminate(n, 2*n + 2, table, row, entering);
    basis[row] = entering;
    if (leaving == 2*n) return LMOC_SOLVED;
    entering = leaving < n ? leaving + n : leaving - n;
    const int64_t count = those_able(table, n, entering, able);
    if (!count) break;
    row = least_ratio(table, n, entering, able, count, basis);
  }
  return LMOC_NO_SOLUTION;
}

int lmoc_lemke(int64_t n, const double *matrix, const double *q, double *z) {
  const int64_t width = 2*n + 2;
  int found = LMOC_SOLVED;
  memset(z, 0, n * sizeof(double));
  for (int64_t k = 0; k < n; k++) found |= !(q[k] >= 0);
  if (!found) return LMOC_SOLVED;
  double *table = calloc(n * width, sizeof(double));
  int64_t *basis = malloc(2*n * sizeof(int64_t));
  found = LMOC_NO_MEMORY;
  if (table && basis) {
    for (int64_t i = 0; i < n; i++) {
      double *row = table + i*width, scale = DBL_MIN;
      for (int64_t j = 0; j < n; j++) scale = fmax(scale, fabs(matrix[i*n + j]));
      for (int64_t j = 0; j < n; j++) row[n + j] = -matrix[i*n + j] / scale;
      row[i] = 1;
      row[2*n] = -1;
      row[2*n + 1] = q[i] / scale;
      basis[i] = i;
    }
    found = pivots(table, n, basis, basis + n);
    for (int64_t i = 0; i < n; i++)
      if (basis[i] >= n && basis[i] < 2*n) z[basis[i] - n] = table[i*width + width - 1];
    for (int64_t k = 0; k < n && !found; k++) z[k] = fmax(z[k], 0);
  }
  free(table);
  free(basis);
  return found;
}

/* ------------------------------------------------------------------ the problem in that form */

typedef struct {
  int64_t n, size;        /* components; (b+ for friction), b-, s of friction, multipliers of upper bounds */
  double *big, *right, *least, *z;
  int64_t *boxed, count;  /* components with upper bounds */
} lemke_form;

static void fill(const lemke_form *f, const double *matrix, const double *q, const double *upper,
                 const lmoc_friction *friction) {
  const int64_t n = f->n, size = f->size, k = friction->count, back = n, speed = n + k, over = n + 2*k;
  const double *least = f->least;
  double *big = f->big;
  for (int64_t i = 0; i < n; i++) memcpy(big + i*size, matrix + i*n, n * sizeof(double));
  lmoc_affine(n, matrix, least, q, f->right);
  for (int64_t a = 0; a < k; a++) {
    const int64_t row = friction->rows[a];
    for (int64_t j = 0; j < n; j++) {
      big[j*size + back + a] = -matrix[j*n + row];
      big[(back + a)*size + j] = -matrix[row*n + j];
    }
    for (int64_t b = 0; b < k; b++) big[(back + a)*size + back + b] = matrix[row*n + friction->rows[b]];
    f->right[back + a] = -f->right[row];
    big[row*size + speed + a] = big[(back + a)*size + speed + a] = 1;
    big[(speed + a)*size + row] = big[(speed + a)*size + back + a] = -1;
    big[(speed + a)*size + friction->normal[a]] = friction->share[a];
    f->right[speed + a] = friction->share[a] * least[friction->normal[a]];
  }
  for (int64_t b = 0; b < f->count; b++) {
    const int64_t row = f->boxed[b];
    big[row*size + over + b] = 1;
    big[(over + b)*size + row] = -1;
    f->right[over + b] = upper[row] - least[row];
  }
}

static void read(const lemke_form *f, const double *matrix, const double *q, const lmoc_friction *friction, double *x,
                 double *w, int64_t *side) {
  const int64_t n = f->n, k = friction->count;
  const double *z = f->z;
  for (int64_t i = 0; i < n; i++) {
    x[i] = f->least[i] + z[i];
    side[i] = z[i] > 0 ? LMOC_FREE : LMOC_LOWER;
  }
  for (int64_t a = 0; a < k; a++) x[friction->rows[a]] -= z[n + a];
  for (int64_t b = 0; b < f->count; b++)
    if (z[n + 2*k + b] > 0) side[f->boxed[b]] = LMOC_UPPER;
  for (int64_t a = 0; a < k; a++) {
    const double own = x[friction->rows[a]], limit = friction->share[a] * x[friction->normal[a]];
    const int sliding = fabs(own) >= limit * (1 - LMOC_AT_LIMIT);
    side[friction->rows[a]] = !sliding ? LMOC_FREE : own < 0 ? LMOC_LOWER : LMOC_UPPER;
  }
  lmoc_affine(n, matrix, x, q, w);
}

int lmoc_with_cones(int64_t n, const double *matrix, const double *q, const double *lower, const double *upper,
                    const lmoc_friction *friction, double *x, double *w, int64_t *side) {
  const int64_t most = 2*n + 2*friction->count;
  double *memory = calloc(most * most + 2*most + n, sizeof(double));
  int64_t *boxed = malloc((n + 1) * sizeof(int64_t));
  int found = LMOC_NO_MEMORY;
  if (memory && boxed) {
    double *m = memory + most * most;
    lemke_form f = {n, 0, memory, m, m + 2*most, m + most, boxed, 0};
    for (int64_t i = 0; i < n; i++) {
      int rubs = 0;
      for (int64_t a = 0; a < friction->count; a++) rubs |= friction->rows[a] == i;
      f.least[i] = rubs ? 0 : lower[i];
      if (!rubs && isfinite(upper[i])) boxed[f.count++] = i;
    }
    f.size = n + 2*friction->count + f.count;
    fill(&f, matrix, q, upper, friction);
    found = lmoc_lemke(f.size, f.big, f.right, f.z);
    if (found == LMOC_SOLVED) read(&f, matrix, q, friction, x, w, side);
    else for (int64_t i = 0; i < n; i++) x[i] = f.z[i];
  }
  free(memory);
  free(boxed);
  return found;
}
