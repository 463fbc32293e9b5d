/* The place of a crossing, and of a minimum.

   For most functions a call costs about the same for one time as for a dozen. So each one looks at the place that the
   values known so far give, at places ever nearer to it on both sides, and at the middle: for a smooth function the
   bracket shrinks with a high power of its length, and never by less than half. On DOP853's dense output that takes 2 or
   3 calls, the ITP method 17. */

#include "roots.h"

#include <math.h>

static const double NEAR[] = {1e-2, 1e-4, 1e-6, 1e-9, 1e-12}; /* shares of a bracket */
static const double ALIKE = 1e-2;     /* share of a value: others that are this close tell nothing new */
static const double TIGHT = 4e-16;    /* of the time: two places that close are one */
static const double SETTLED = 1e-15;  /* the shortest step of Newton's method on a polynomial in 0 ... 1 */
static const double GOLDEN = 0.6180339887498949;
enum { SHARES = sizeof NEAR / sizeof *NEAR, PLACES = 2*SHARES + 4, MOST_CALLS = 60, POINTS = 5, DEGREE = 7, NEWTON = 30,
       NARROWED = 30 };

/* A zero in 0 ... 1 of the polynomial through some values, positive at 0 and negative at 1: Newton's divided differences,
   and his method. */
static double zero_between(int64_t count, const double *times, const double *values, double a, double b) {
  double t[DEGREE], c[DEGREE], low = 0, high = 1, at = 0.5;
  for (int64_t i = 0; i < count; i++) {
    t[i] = (times[i] - a) / (b - a);
    c[i] = values[i];
  }
  for (int64_t order = 1; order < count; order++)
    for (int64_t i = count - 1; i >= order; i--) c[i] = (c[i] - c[i - 1]) / (t[i] - t[i - order]);
  for (int round = 0; round < NEWTON; round++) {
    double value = c[count - 1], slope = 0;
    for (int64_t i = count - 2; i >= 0; i--) {
      slope = slope * (at - t[i]) + value;
      value = value * (at - t[i]) + c[i];
    }
    if (value < 0) high = at;
    else low = at;
    const double step = slope != 0 ? value / slope : INFINITY;
    if (fabs(step) < SETTLED) break;
    at = low < at - step && at - step < high ? at - step : 0.5 * (low + high);
  }
  return at;
}

/* Where a function crosses zero, by inverse interpolation in its lowest values, else by the secant. The last two places
   are the ends of the bracket. */
static double guess(int64_t count, const double *times, const double *values) {
  const double a = times[count - 2], b = times[count - 1], at_a = values[count - 2], at_b = values[count - 1];
  int64_t chosen[POINTS], points = 0;
  double place = a;
  for (; points < POINTS; points++) {
    int64_t best = -1;
    for (int64_t i = 0; i < count; i++) {
      int known = !(values[i] * 0 == 0);
      for (int64_t j = 0; j < points; j++) known |= !(fabs(values[chosen[j]] - values[i]) > ALIKE * fabs(values[i]));
      if (!known && (best < 0 || fabs(values[i]) < fabs(values[best]))) best = i;
    }
    if (best < 0) break;
    chosen[points] = best;
  }
  for (int64_t i = 0; i < points && count > 2; i++) {
    double weight = times[chosen[i]] - a;
    for (int64_t j = 0; j < points; j++)
      if (j != i) weight *= values[chosen[j]] / (values[chosen[j]] - values[chosen[i]]);
    place += weight;
  }
  return a < place && place < b ? place : (at_a * b - at_b * a) / (at_a - at_b);
}

/* Places within a bracket, in order. */
static int64_t around(double place, double least, double a, double b, double *places) {
  double found[PLACES] = {place, place - least, place + least, (a + b) / 2};
  int64_t count = 0;
  for (int k = 0; k < SHARES; k++) {
    found[4 + 2*k] = place - (b - a) * NEAR[k];
    found[5 + 2*k] = place + (b - a) * NEAR[k];
  }
  for (int k = 0; k < PLACES; k++) {
    if (!(found[k] > a && found[k] < b)) continue;
    int64_t i = count++;
    for (; i > 0 && places[i - 1] > found[k]; i--) places[i] = places[i - 1];
    places[i] = found[k];
  }
  return count;
}

int lmoc_locate(lmoc_curve curve, void *own, double a, double b, double at_a, double at_b, int64_t points,
                const double *near_times, const double *near_values, double *time) {
  const double least = TIGHT * fmax(fabs(a), fabs(b)); /* from zero on, of the bracket: what is 1e-320 s behind it has no
                                                          digits */
  double places[PLACES + 2], values[PLACES + 2];
  int64_t count = 0;
  int halted = 0;
  if (points > DEGREE) { /* those around the bracket */
    int64_t first = 0;
    while (first < points - DEGREE && near_times[first + DEGREE/2] < a) first++;
    near_times += first;
    near_values += first;
    points = DEGREE;
  }
  for (int call = 0; call < MOST_CALLS && b - a > 2*least; call++) {
    double place;
    if (points && !call) place = a + (b - a) * zero_between(points, near_times, near_values, a, b);
    else {
      places[count] = a, values[count] = at_a, places[count + 1] = b, values[count + 1] = at_b;
      place = guess(count + 2, places, values);
    }
    count = around(place, least, a, b, places);
    if (!count) break;
    if ((halted = curve(own, count, places, values))) return halted;
    int64_t k = 0;
    while (k < count && !(values[k] < 0)) k++;
    if (k < count) b = places[k], at_b = values[k];
    if (k > 0) a = places[k - 1], at_a = values[k - 1];
  }
  *time = b;
  return 0;
}

int lmoc_lowest(lmoc_curve curve, void *own, double a, double b, double *time, double *value) {
  double c = b - GOLDEN * (b - a), d = a + GOLDEN * (b - a), at_c, at_d;
  int halted = 0;
  if ((halted = curve(own, 1, &c, &at_c)) || (halted = curve(own, 1, &d, &at_d))) return halted;
  for (int round = 0; round < NARROWED && !(at_c < 0 || at_d < 0); round++) {
    if (at_c < at_d) {
      b = d, d = c, at_d = at_c;
      c = b - GOLDEN * (b - a);
      halted = curve(own, 1, &c, &at_c);
    } else {
      a = c, c = d, at_c = at_d;
      d = a + GOLDEN * (b - a);
      halted = curve(own, 1, &d, &at_d);
    }
    if (halted) return halted;
  }
  *time = at_c < at_d ? c : d;
  *value = at_c < at_d ? at_c : at_d;
  return 0;
}

int lmoc_lowest_about(lmoc_curve curve, void *own, int64_t count, const double *times, double *time, double *value) {
  int64_t least = 0;
  for (int64_t k = 0; k < count; k++) {
    double here;
    const int halted = curve(own, 1, times + k, &here);
    if (halted) return halted;
    if (!k || !(here >= *value)) *value = here, least = k;
    if (here != here) break;
  }
  return lmoc_lowest(curve, own, times[least > 0 ? least - 1 : 0], times[least + 1 < count ? least + 1 : least], time, value);
}
