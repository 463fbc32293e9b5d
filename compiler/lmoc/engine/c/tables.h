/* Tables as signals: piecewise polynomials that hold their ends, as `numerics/signals/curves.py` makes them. */

#ifndef LMOC_TABLES_H
#define LMOC_TABLES_H

#include <stdint.h>

enum { LMOC_DEGREES = 6 }; /* coefficients of a piece at the most */

typedef struct {
  int64_t place, order, knot_count, degrees; /* the register that it fills with a derivative of an order */
  const double *knots, *coefficients, *low, *high, *ends;
  int64_t at;                                /* the piece that was asked for last */
} lmoc_table;

typedef struct {
  int64_t count;
  lmoc_table *table;
} lmoc_tables;

/* Put the values at a time into their registers; where a curve jumps, that behind the jump. */
void lmoc_tables_fill(const lmoc_tables *c, double time, double *w);

/* The other coefficients of their Taylor series about a time, from the first order on: a series for each register, or -1,
   so far apart. */
void lmoc_tables_series(const lmoc_tables *c, double time, const int32_t *of_register, int64_t apart, double *s);

#endif
