/* Steps checked by bounds, without Python in between (``lmoc_step_hook``); those that are certainly good are put on
   record. Where a bound does not hold, `coordinates/watch.py` has to look at the step. */

#include "engine.h"

/* The bounds of one plan. What is given and what is found stand one behind the other as in `bounds_layout.BoundsLayout`;
   matrices are (rows, columns), tableaus (watched, states). */
typedef struct {
  double *w;                              /* registers from which the entries follow … */
  const lmoc_tape *tape;
  int64_t rows, columns, count, states, entries, watched, told, squarings, again;
  double unexplained, grown, neighbours, normal, rounding; /* as in `condition_bounds.py` and `tableau.py` */
  const int32_t *entry, *target;          /* … their registers, and to which place each of them is added */
  const int32_t *place, *row;             /* places in the matrix; the rows that are watched */
  double *work;                           /* 2*rows*columns + 2*rows*rows + 5*columns + 5*rows + count */
} bounds_of;

static double *matrix_of(const bounds_of *c, int k) { return c->work + k*c->rows*c->columns; }
static double *square_of(const bounds_of *c, int k) { return c->work + 2*c->rows*c->columns + k*c->rows*c->rows; }

/* A^-1 B by elimination with row pivoting, in place; the sign of the determinant of A. */
static double eliminate(const bounds_of *c, double *a) {
  const int64_t rows = c->rows, columns = c->columns;
  double sign = 1;
  for (int64_t k = 0; k < rows; k++) {
    int64_t p = k;
    for (int64_t i = k + 1; i < rows; i++) if (fabs(a[i*columns + k]) > fabs(a[p*columns + k])) p = i;
    if (p != k) {
      sign = -sign;
      for (int64_t j = k; j < columns; j++) {
        const double x = a[k*columns + j];
        a[k*columns + j] = a[p*columns + j];
        a[p*columns + j] = x;
      }
    }
    sign *= lmoc_sign(a[k*columns + k]);
    for (int64_t i = k + 1; i < rows; i++) {
      const double f = a[i*columns + k] / a[k*columns + k];
      if (f != 0) for (int64_t j = k + 1; j < columns; j++) a[i*columns + j] -= f*a[k*columns + j];
    }
  }
  for (int64_t k = rows - 1; k >= 0; k--)
    for (int64_t j = rows; j < columns; j++) {
      double x = a[k*columns + j];
      for (int64_t i = k + 1; i < rows; i++) x -= a[k*columns + i]*a[i*columns + j];
      a[k*columns + j] = x / a[k*columns + k];
    }
  return sign;
}

/* A lower bound of the smallest singular value of M: of M*M^T by Cholesky's factor, its inverse, and squares of that. */
static double least_singular_value(const bounds_of *c, const double *m, double *s, double *t) {
  const int64_t n = c->rows, columns = c->columns;
  for (int64_t i = 0; i < n; i++)
    for (int64_t j = 0; j <= i; j++) {
      double x = 0;
      for (int64_t k = 0; k < columns; k++) x += m[i*columns + k]*m[j*columns + k];
      for (int64_t k = 0; k < j; k++) x -= s[i*n + k]*s[j*n + k];
      s[i*n + j] = i == j ? sqrt(x) : x/s[j*n + j];
    }
  for (int64_t j = 0; j < n; j++)
    for (int64_t i = j; i < n; i++) {
      double x = i == j;
      for (int64_t k = j; k < i; k++) x -= s[i*n + k]*t[k*n + j];
      t[i*n + j] = x/s[i*n + i];
    }
  for (int64_t i = 0; i < n; i++)
    for (int64_t j = 0; j <= i; j++) {
      double x = 0;
      for (int64_t k = i; k < n; k++) x += t[k*n + i]*t[k*n + j];
      s[i*n + j] = s[j*n + i] = x;
    }
  for (int64_t q = 0; q < c->squarings; q++) {
    for (int64_t i = 0; i < n; i++)
      for (int64_t j = 0; j <= i; j++) {
        double x = 0;
        for (int64_t k = 0; k < n; k++) x += s[i*n + k]*s[j*n + k];
        t[i*n + j] = t[j*n + i] = x;
      }
    memcpy(s, t, n*n * sizeof(double));
  }
  double sum = 0;
  for (int64_t k = 0; k < n*n; k++) sum += s[k]*s[k];
  return pow(sum, -1.0/(double)(4 << c->squarings));
}

/* The most that velocities leave unexplained of the way of a dependent coordinate, beyond what they may. */
static double unexplained_way(const bounds_of *c, const double *table, const double *by_rows, const double *before,
                              const double *after, const double *brief) {
  double worst = -INFINITY;
  for (int64_t r = 0; r < c->watched; r++) {
    const double way = after[c->row[r]] - before[c->row[r]];
    double rest = way;
    for (int64_t j = 0; j < c->states; j++)
      rest += (table[r*c->states + j] + by_rows[r*c->states + j])/2*(after[c->rows + j] - before[c->rows + j]);
    worst = lmoc_max(worst, fabs(rest) - fmax(c->unexplained*fabs(way), brief[r]));
  }
  return worst;
}

/* The bounds for a step, from what is given into what is found. */
void lmoc_condition_bounds(const bounds_of *c, double time, const double *given, double *now) {
  const int64_t count = c->count, columns = c->columns, table_size = c->watched*c->states;
  const double *table = given + count, *before = table + table_size, *after = before + c->told, *factor = after + c->told,
               *size = factor + count, *bound = size + count, *scale = bound + count, *brief = scale + table_size;
  double *by_rows = now + count, *larger = by_rows + table_size, *bounds = larger + count;
  double *a = matrix_of(c, 0), *even = matrix_of(c, 1), worst = 0, change = 0, grown = -INFINITY, finite = 0;
  c->tape->run(time, c->w, c->tape);
  memset(a, 0, 2*c->rows*columns * sizeof(double));
  for (int64_t k = 0; k < count; k++) now[k] = 0;
  for (int64_t e = 0; e < c->entries; e++) now[c->target[e]] += c->w[c->entry[e]];
  for (int64_t k = 0; k < count; k++) {
    const double moved = (now[k] - given[k])*factor[k];
    a[c->place[k]] = now[k];
    even[c->place[k]] = now[k]*factor[k];
    if (c->place[k] % columns < c->rows) finite += 0*now[k];
    change += moved*moved;
    larger[k] = fmax(size[k], fabs(now[k]));
    grown = lmoc_max(grown, larger[k] - bound[k]);
  }
  const double sign = eliminate(c, a);
  for (int64_t r = 0; r < c->watched; r++)
    for (int64_t j = 0; j < c->states; j++) {
      by_rows[r*c->states + j] = a[c->row[r]*columns + c->rows + j];
      worst = lmoc_max(worst, fabs(by_rows[r*c->states + j]*scale[r*c->states + j]));
    }
  bounds[0] = worst;
  bounds[1] = finite == 0 ? sign : 0;
  bounds[2] = least_singular_value(c, even, square_of(c, 0), square_of(c, 1));
  bounds[3] = sqrt(change);
  bounds[4] = c->told ? unexplained_way(c, table, by_rows, before, after, brief) : 0;
  bounds[5] = grown;
}

/* The judging of the steps of one system. */
typedef struct {
  void *call;                             /* the system, with what evaluates it … */
  int (*evaluate)(void *call, double time, const double *x);
  void (*mark)(void *call);               /* … and marks where it has been solved last */
  const double *registers;                /* of the system */
  const bounds_of *by;
  double *given, *found;
  const int32_t *reads, *told, *solved;   /* registers that bounds read; of the coordinates, of the unknowns of blocks */
  int64_t read_count, solved_count, n;
  double limit, sure, share, sign, least; /* what bounds are compared with; `least` is that where the step begins */
  double *rows, *columns;                 /* factors with which rows and columns have one length … */
  const double *counted;                  /* … and 1 for each row of the tableau that counts, else 0 */
  int64_t rescaled;                       /* how often these have been made anew */
  double *places;                         /* (room, 1 + n + solved_count) times, states, solutions */
  int64_t count, room;
} step_check;

/* The squared factors of rows and columns for squared entries (Sinkhorn's iteration): `equilibrated` in
   `coordinates/tableau.py`. */
static void equilibrate(const bounds_of *c, const double *square, const double *in_row, const double *in_column,
                        double *row, double *column, double *sum) {
  for (int64_t n = 0;; n++) {
    double changed = 0;
    for (int64_t i = 0; i < c->rows; i++) row[i] = in_row[i] == 0;
    for (int64_t k = 0; k < c->count; k++) row[c->place[k]/c->columns] += square[k]*column[c->place[k] % c->columns];
    for (int64_t i = 0; i < c->rows; i++) row[i] = 1/row[i];
    if (n == c->again) return;
    for (int64_t j = 0; j < c->columns; j++) sum[j] = in_column[j] == 0;
    for (int64_t k = 0; k < c->count; k++) sum[c->place[k] % c->columns] += row[c->place[k]/c->columns]*square[k];
    for (int64_t j = 0; j < c->columns; j++) {
      changed = fmax(changed, fabs(column[j]*sum[j] - 1));
      column[j] = 1/sum[j];
    }
    if (n % 2 && changed <= c->normal) n = c->again - 1;
  }
}

/* Factors of rows and columns for the sizes to which entries have grown, and what follows from them in `watch.py`. The
   smallest singular value shrinks by no more than both together. */
static void rescale(step_check *s) {
  const bounds_of *c = s->by;
  const int64_t rows = c->rows, columns = c->columns, count = c->count, table_size = c->watched*c->states;
  double *factor = s->given + count + table_size + 2*c->told, *size = factor + count, *bound = size + count,
         *scale = bound + count, *brief = scale + table_size;
  double *largest = square_of(c, 2), *row = largest + rows, *in_row = row + rows, *column = in_row + rows,
         *in_column = column + columns, *range = in_column + columns, *sum = range + columns, *square = sum + columns;
  double least_row = INFINITY, least_column = INFINITY;
  memset(largest, 0, (3*rows + 4*columns) * sizeof(double));
  for (int64_t k = 0; k < count; k++) largest[c->place[k]/columns] = fmax(largest[c->place[k]/columns], size[k]);
  for (int64_t k = 0; k < count; k++) {
    const int64_t i = c->place[k]/columns, j = c->place[k] % columns;
    square[k] = size[k]*0 == 0 && size[k] > c->rounding*largest[i] ? size[k]*size[k] : 0;
    in_row[i] += square[k];
    in_column[j] += square[k];
    if (largest[i] > 0) range[j] = fmax(range[j], size[k]/largest[i]);
  }
  for (int64_t j = 0; j < columns; j++) column[j] = s->columns[j]*s->columns[j];
  equilibrate(c, square, in_row, in_column, row, column, sum);
  for (int64_t i = 0; i < rows; i++) {
    const double now = sqrt(row[i]);
    least_row = fmin(least_row, now/s->rows[i]);
    s->rows[i] = now;
  }
  for (int64_t j = 0; j < columns; j++) {
    const double now = sqrt(column[j]);
    least_column = fmin(least_column, now/s->columns[j]);
    s->columns[j] = now;
    if (!(range[j] > 0)) range[j] = 1;
  }
  s->least *= fmin(1, least_row*least_column);
  for (int64_t k = 0; k < count; k++) {
    factor[k] = s->rows[c->place[k]/columns]*s->columns[c->place[k] % columns];
    bound[k] = c->grown*size[k];
  }
  for (int64_t r = 0; r < c->watched; r++) {
    brief[r] = c->neighbours*s->columns[c->row[r]];
    for (int64_t j = 0; j < c->states; j++) scale[r*c->states + j] = s->counted[r]*range[c->row[r]]/range[rows + j];
  }
  s->rescaled++;
}

/* 0 where the step to a place is certainly good. Written so that what is no number is not. */
int lmoc_step_check_look(void *own, double time, const double *x, int first) {
  step_check *s = own;
  const bounds_of *c = s->by;
  const int64_t count = c->count, table_size = c->watched*c->states;
  double *after = s->given + count + table_size + c->told, *size = after + c->told + count;
  const double *larger = s->found + count + table_size, *bounds = larger + count;
  (void)first;
  if (s->count == s->room || s->evaluate(s->call, time, x)) return 1;
  for (int64_t k = 0; k < c->told; k++) after[k] = s->registers[s->told[k]];
  for (int64_t k = 0; k < s->read_count; k++) c->w[s->reads[k]] = s->registers[s->reads[k]];
  lmoc_condition_bounds(c, time, s->given, s->found);
  memcpy(size, larger, count * sizeof(double));
  if (bounds[5] > 0) {
    rescale(s);
    lmoc_condition_bounds(c, time, s->given, s->found);
  }
  if (!(bounds[0] <= s->limit && bounds[1] == s->sign && bounds[2] > s->sure && bounds[4] <= 0 && bounds[5] <= 0
        && bounds[3] <= s->share * (s->least + bounds[2]))) return 1;
  double *place = s->places + s->count*(1 + s->n + s->solved_count);
  place[0] = time;
  memcpy(place + 1, x, s->n * sizeof(double));
  for (int64_t k = 0; k < s->solved_count; k++) place[1 + s->n + k] = s->registers[s->solved[k]];
  return 0;
}

/* Go on from the end of the step looked at last. */
void lmoc_step_check_keep(void *own) {
  step_check *s = own;
  const bounds_of *c = s->by;
  const int64_t known = c->count + c->watched*c->states;
  double *before = s->given + known;
  memcpy(s->given, s->found, known * sizeof(double));
  for (int64_t k = 0; k < c->told; k++) before[k] = before[c->told + k];
  s->least = s->found[2*c->count + c->watched*c->states + 2];
  s->mark(s->call);
  s->count++;
}
