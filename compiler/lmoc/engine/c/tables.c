/* Values of tables. They are asked for in order almost always, so that the piece is the last one or the next. */

#include "tables.h"

#include "tape.h"

/* The piece in which a time between the first and the last knot lies. */
static int64_t piece_of(lmoc_table *c, double t) {
  const int64_t last = c->knot_count - 1;
  int64_t low = c->at, high = last;
  if (c->knots[low] <= t) {
    if (low == last - 1 || t < c->knots[low + 1]) return low;
    if (low == last - 2 || t < c->knots[low + 2]) return c->at = low + 1;
  } else low = 0;
  while (high - low > 1) {
    const int64_t middle = (low + high) / 2;
    if (c->knots[middle] <= t) low = middle;
    else high = middle;
  }
  return c->at = low;
}

static int is_inside(const lmoc_table *c, double t) { return t >= c->knots[0] && t <= c->knots[c->knot_count - 1]; }

/* The length of a piece, and where a time lies in it as a share of that; nobody is ever within a jump. */
static double share(const lmoc_table *c, int64_t k, double t, double *length) {
  const double between = c->knots[k + 1] - c->knots[k];
  *length = between != 0 ? between : 1;
  return (t - c->knots[k]) / *length;
}

static double value_at(lmoc_table *c, double t) {
  const int64_t last = c->knot_count - 1;
  if (!is_inside(c, t) || (t == c->knots[last] && c->order == 0)) return c->order > 0 ? 0 : c->ends[t >= c->knots[last]];
  const int64_t k = piece_of(c, t);
  double length, value = 0, unit = 1;
  const double u = share(c, k, t, &length);
  for (int64_t j = c->degrees - 1; j >= 0; j--) value = value*u + c->coefficients[k*c->degrees + j];
  for (int64_t j = 0; j < c->order; j++) unit *= length;
  return c->order > 0 ? value / unit : lmoc_min(lmoc_max(value, c->low[k]), c->high[k]);
}

void lmoc_tables_fill(const lmoc_tables *c, double time, double *w) {
  for (int64_t k = 0; k < c->count; k++) w[c->table[k].place] = value_at(c->table + k, time);
}

/* Taylor coefficients of a piece, by repeated division by (u - its place). */
static void coefficients_at(lmoc_table *c, double t, double *s) {
  const int64_t k = piece_of(c, t), degrees = c->degrees;
  double length, unit = 1, b[LMOC_DEGREES];
  const double u = share(c, k, t, &length);
  memcpy(b, c->coefficients + k*degrees, degrees * sizeof(double));
  for (int64_t i = 0; i < degrees; i++)
    for (int64_t j = degrees - 2; j >= i; j--) b[j] += u*b[j + 1];
  for (int64_t j = 0; j < c->order; j++) unit *= length;
  for (int64_t j = 1; j < degrees; j++) s[j] = b[j] / (unit *= length);
}

void lmoc_tables_series(const lmoc_tables *c, double time, const int32_t *of_register, int64_t apart, double *s) {
  for (int64_t k = 0; k < c->count; k++) {
    lmoc_table *own = c->table + k;
    const int32_t series = of_register[own->place];
    if (series < 0) continue;
    for (int64_t j = 1; j < LMOC_DEGREES; j++) s[series*apart + j] = 0;
    if (is_inside(own, time)) coefficients_at(own, time, s + series*apart);
  }
}
