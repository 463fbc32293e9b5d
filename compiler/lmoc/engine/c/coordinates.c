/* Choices of coordinates of one constraint matrix.

   An entry of the tableau T = A^-1 B is the factor by which the determinant of A grows if that dependent coordinate and
   that state change places. So a choice is good as long as no entry is large, and the exchange at the largest entry is the
   best single one (Goreinov, Oseledets, Savostyanov, Tyrtyshnikov and Zamarashkin, How to find a good submatrix, 2010; the
   partitioning of coordinates is Wehage and Haug's, J. Mech. Design 104, 1982). */

#include "coordinates.h"

enum { NORMALIZATIONS = 30, AGAIN = 6, EXCHANGES = 4 }; /* of rows and columns; exchanges for each entry of a tableau */

/* By alternating normalization of the squared entries (Sinkhorn and Knopp, Pacific J. Math. 21, 1967) until that changes
   little. Rows and columns of nothing keep the factor 1. */
void lmoc_equilibrate(const lmoc_coordinate_limits *by, int64_t rows, int64_t columns, int64_t count, const int32_t *place,
                      const double *size, const double *units, int again, double *row, double *column, double *range,
                      double *work) {
  double *largest = work, *in_row = largest + rows, *squared_row = in_row + rows, *in_column = squared_row + rows,
         *sum = in_column + columns, *squared = sum + columns, *square = squared + columns;
  memset(work, 0, (3*rows + 3*columns) * sizeof(double));
  memset(range, 0, columns * sizeof(double));
  for (int64_t k = 0; k < count; k++)
    largest[place[k]/columns] = fmax(largest[place[k]/columns], size[k]*units[place[k] % columns]);
  for (int64_t k = 0; k < count; k++) {
    const int64_t i = place[k]/columns, j = place[k] % columns;
    square[k] = size[k]*0 == 0 && size[k]*units[j] > by->no_entry*largest[i] ? size[k]*size[k] : 0;
    in_row[i] += square[k];
    in_column[j] += square[k];
    if (square[k] > 0) range[j] = fmax(range[j], size[k]/largest[i]); /* of what rounding leaves of zeros there is none */
  }
  for (int64_t j = 0; j < columns; j++) {
    squared[j] = again ? column[j]*column[j] : 1;
    if (!(range[j] > 0)) range[j] = 1;
  }
  const int64_t most = again ? AGAIN : NORMALIZATIONS;
  for (int64_t n = 0;; n++) {
    double changed = 0;
    for (int64_t i = 0; i < rows; i++) squared_row[i] = in_row[i] == 0;
    for (int64_t k = 0; k < count; k++) squared_row[place[k]/columns] += square[k]*squared[place[k] % columns];
    for (int64_t i = 0; i < rows; i++) squared_row[i] = 1/squared_row[i];
    if (n == most) break;
    for (int64_t j = 0; j < columns; j++) sum[j] = in_column[j] == 0;
    for (int64_t k = 0; k < count; k++) sum[place[k] % columns] += squared_row[place[k]/columns]*square[k];
    for (int64_t j = 0; j < columns; j++) {
      changed = fmax(changed, fabs(squared[j]*sum[j] - 1));
      squared[j] = 1/sum[j];
    }
    if (n % 2 && changed <= by->normal) n = most - 1;
  }
  for (int64_t i = 0; i < rows; i++) row[i] = sqrt(squared_row[i]);
  for (int64_t j = 0; j < columns; j++) column[j] = sqrt(squared[j]);
}

void lmoc_rows_of_one_size(int64_t rows, int64_t columns, int64_t count, const int32_t *place, const double *units,
                           double *entries, double *work) {
  memset(work, 0, rows * sizeof(double));
  for (int64_t k = 0; k < count; k++) {
    entries[k] *= units[place[k] % columns];
    work[place[k]/columns] = fmax(work[place[k]/columns], fabs(entries[k]));
  }
  for (int64_t k = 0; k < count; k++) entries[k] /= work[place[k]/columns] > 0 ? work[place[k]/columns] : 1;
}

int lmoc_states_by_pivots(const lmoc_coordinate_limits *by, int64_t rows, int64_t columns, double *a, int32_t *held) {
  int64_t states = 0;
  for (int64_t j = 0; j < columns; j++) held[j] = 1;
  for (int64_t n = 0; n < rows; n++) {
    int64_t at = n*columns;
    for (int64_t k = at; k < rows*columns; k++) if (fabs(a[k]) > fabs(a[at])) at = k;
    if (!(fabs(a[at]) > by->no_entry)) return 0;
    const int64_t r = at / columns, c = at % columns;
    for (int64_t j = 0; j < columns && r != n; j++) {
      const double x = a[n*columns + j];
      a[n*columns + j] = a[r*columns + j];
      a[r*columns + j] = x;
    }
    for (int64_t i = n + 1; i < rows; i++) {
      const double f = a[i*columns + c] / a[n*columns + c];
      for (int64_t j = 0; j < columns; j++) a[i*columns + j] -= f*a[n*columns + j];
      a[i*columns + c] = 0;
    }
    held[c] = 0;
  }
  for (int64_t j = 0; j < columns; j++) if (held[j]) held[states++] = (int32_t)j;
  return states > 0 && held[0] < rows;
}

/* Let a dependent coordinate i and a state j change places. */
static void exchange(int64_t rows, int64_t states, double *table, int64_t i, int64_t j) {
  const double pivot = table[i*states + j];
  for (int64_t c = 0; c < states; c++) if (c != j) table[i*states + c] /= pivot;
  for (int64_t r = 0; r < rows; r++) {
    const double f = table[r*states + j];
    if (r == i) continue;
    for (int64_t c = 0; c < states; c++) if (c != j) table[r*states + c] -= f*table[i*states + c];
    table[r*states + j] = -f / pivot;
  }
  table[i*states + j] = 1 / pivot;
}

int lmoc_exchanges(double good, int64_t rows, int64_t states, double *table, uint8_t *barred, int32_t *dependent,
                   int32_t *held) {
  int found = 0;
  for (int64_t round = 0; round < EXCHANGES*rows*states; round++) {
    int64_t at = -1;
    double most = good;
    for (int64_t k = 0; k < rows*states && most == most; k++)
      if (!barred[k/states] && !(fabs(table[k]) <= most)) most = fabs(table[at = k]);
    if (at < 0 || most*0 != 0) break;
    const int64_t i = at / states, j = at % states;
    const int32_t state = held[j];
    held[j] = dependent[i];
    dependent[i] = state;
    barred[i] = 0; /* what was a state there can be one again */
    exchange(rows, states, table, i, j);
    if (found < 2) found++;
    if (!round) memcpy(held + states, held, states * sizeof(int32_t));
  }
  return found;
}
