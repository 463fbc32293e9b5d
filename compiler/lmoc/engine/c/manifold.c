/* Gauss-Jordan elimination in the derivatives of gaps and rates: the way back onto them, and velocities that they hold. */

#include "manifold.h"
#include "dense.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double DEPENDENT = 1e-10; /* a pivot below this share of the largest entry of its row: the row depends on
                                          others */
static const double NO_ENTRY = 1e-12;  /* `numerics/limits.py` */
static const double LARGE = 0.1;       /* of the largest entry of a row: such a pivot is good enough */

static double largest(const double *row, int64_t columns) {
  double most = 0;
  for (int64_t j = 0; j < columns; j++) most = fmax(most, fabs(row[j]));
  return most;
}

/* ------------------------------------------------------------------ onto the manifold */

/* A part of the rows, (count, width) with the right side last, by elimination with full pivoting: `chosen` tells in which
   column each row has its pivot, -1 for none. */
static void eliminate(int64_t count, int64_t width, double *work, double *scale, int64_t *chosen) {
  for (int64_t i = 0; i < count; i++) {
    scale[i] = largest(work + i*width, width - 1);
    chosen[i] = -1;
  }
  for (int64_t step = 0; step < count; step++) {
    int64_t row = -1, column = -1;
    double most = DEPENDENT;
    for (int64_t i = 0; i < count; i++)
      for (int64_t j = 0; j < width - 1 && chosen[i] < 0 && scale[i] > 0; j++)
        if (fabs(work[i*width + j]) / scale[i] > most) {
          most = fabs(work[i*width + j]) / scale[i];
          row = i;
          column = j;
        }
    if (row < 0) return;
    lmoc_dense_eliminate(count, width, work, row, column);
    chosen[row] = column;
  }
}

/* The rows that have columns in common with the first one, and their columns; `first` (rows,) are the parts. */
static void correct(int64_t rows, int64_t columns, const double *a, const double *b, int64_t own, int64_t *first,
                    double *work, double *scale, int64_t *which, int64_t *chosen, double *dx) {
  int64_t *touched = which + rows, count = 0, width = 0;
  for (int64_t i = own; i < rows; i++)
    if (lmoc_first_of(first, i) == own) which[count++] = i;
  for (int64_t j = 0; j < columns; j++) {
    int some = 0;
    for (int64_t i = 0; i < count && !some; i++) some = a[which[i]*columns + j] != 0;
    if (some) touched[width++] = j;
  }
  for (int64_t i = 0; i < count; i++) {
    for (int64_t j = 0; j < width; j++) work[i*(width + 1) + j] = a[which[i]*columns + touched[j]];
    work[i*(width + 1) + width] = b[which[i]];
  }
  eliminate(count, width + 1, work, scale, chosen);
  for (int64_t i = 0; i < count; i++)
    if (chosen[i] >= 0) dx[touched[chosen[i]]] = work[i*(width + 1) + width];
}

int lmoc_correction(int64_t rows, int64_t columns, const double *a, const double *b, double *dx) {
  double *work = malloc((rows * (columns + 2) + 1) * sizeof(double));
  int64_t *places = malloc((3*rows + columns + 1) * sizeof(int64_t)), *first = places, *which = places + rows;
  int status = LMOC_NO_MEMORY;
  memset(dx, 0, columns * sizeof(double));
  if (work && places) {
    status = LMOC_SOLVED;
    for (int64_t i = 0; i < rows; i++) first[i] = i;
    for (int64_t j = 0; j < columns; j++)
      for (int64_t i = 0, last = -1; i < rows; i++)
        if (a[i*columns + j] != 0) {
          if (last >= 0) lmoc_join(first, last, i);
          last = i;
        }
    for (int64_t own = 0; own < rows; own++)
      if (lmoc_first_of(first, own) == own)
        correct(rows, columns, a, b, own, first, work, work + rows * (columns + 1), which, which + rows + columns, dx);
  }
  free(work);
  free(places);
  return status;
}

/* ------------------------------------------------------------------ what is held */

/* The form without what rounding has left of zeros; 0 where it is none. */
static int take(const double *from, int64_t columns, double *to) {
  const double most = largest(from, columns);
  int some = 0;
  for (int64_t j = 0; j < columns; j++) {
    if (from[j] * 0 != 0) return 0;
    to[j] = fabs(from[j]) > NO_ENTRY * most ? from[j] / most : 0;
    some |= to[j] != 0;
  }
  return some;
}

static void take_away(double *row, double factor, const double *own, int64_t columns) {
  for (int64_t j = 0; j < columns; j++) {
    const double change = factor * own[j], left = row[j] - change;
    row[j] = fabs(left) <= NO_ENTRY * fmax(fabs(row[j]), fabs(change)) ? 0 : left;
  }
}

/* Of the largest entries of a form, that which the fewest of those before have too: most forms tie two velocities. */
static int64_t choose(const double *own, const double *before, int64_t count, int64_t columns) {
  const double most = largest(own, columns);
  int64_t best = -1, fewest = count + 1;
  for (int64_t j = 0; j < columns; j++) {
    int64_t met = 0;
    if (!(fabs(own[j]) >= LARGE * most)) continue;
    for (int64_t i = 0; i < count && met < fewest; i++) met += before[i*columns + j] != 0;
    if (met >= fewest) continue;
    fewest = met;
    best = j;
  }
  return most > NO_ENTRY ? best : -1;
}

/* A velocity vanishes where it is a combination of the forms: then it is the only entry of a reduced row, whatever the
   pivots are. */
int lmoc_held_velocities(int64_t forms, int64_t columns, const double *coefficients, lmoc_flag *held) {
  double *work = malloc((forms * columns + 1) * sizeof(double));
  int64_t *pivot = malloc((forms + 1) * sizeof(int64_t)), count = 0;
  for (int64_t j = 0; j < columns; j++) held[j] = 0;
  for (int64_t k = 0; work && pivot && k < forms; k++) {
    double *own = work + count*columns;
    if (!take(coefficients + k*columns, columns, own)) continue;
    for (int64_t i = 0; i < count; i++)
      if (own[pivot[i]] != 0) take_away(own, own[pivot[i]], work + i*columns, columns);
    const int64_t best = choose(own, work, count, columns);
    if (best < 0) continue; /* it depends on the forms before */
    const double size = own[best];
    for (int64_t j = 0; j < columns; j++) own[j] /= size;
    for (int64_t i = 0; i < count; i++)
      if (work[i*columns + best] != 0) take_away(work + i*columns, work[i*columns + best], own, columns);
    pivot[count++] = best;
  }
  for (int64_t i = 0; i < count; i++) {
    int64_t entries = 0;
    for (int64_t j = 0; j < columns; j++) entries += work[i*columns + j] != 0;
    if (entries == 1) held[pivot[i]] = 1;
  }
  const int status = work && pivot ? LMOC_SOLVED : LMOC_NO_MEMORY;
  free(work);
  free(pivot);
  return status;
}
