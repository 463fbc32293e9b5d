/* The first place within a step where a function leaves its side: the rules of `steps/roots.py`. Between the ends of a
   step it may do so and come back. It is therefore looked at inside as well, more closely where the samples do not tell
   how it goes, and where it comes near zero and turns, at its extremum (Shampine & Thompson, Event location for ordinary
   differential equations, Comput. Math. Appl. 39, 2000). */

#include "fmu.h"

static const double BESIDE = 0.01, COARSE = 0.02, TIGHT = 4e-16, GOLDEN = 0.6180339887498949;
enum { NARROWED = 30, MANY = 65, MOST_CALLS = 200 };

typedef struct {
  fmu *f;
  int (*states)(void *own, double time, double *x);
  void *own;
  int64_t count;
  double *values, *sides; /* at one place */
} curve;

/* All functions at a time, as heights above zero on their side. */
static void heights(const curve *c, double time, double *out) {
  fmu *f = c->f;
  double *x = f->moved + 4*f->model->states;
  if (c->states) c->states(c->own, time, x);
  if (fmu_indicators(f, time, x, out)) for (int64_t k = 0; k < c->count; k++) out[k] = NAN;
  for (int64_t k = 0; k < c->count; k++) if (c->sides[k] != 0) out[k] *= c->sides[k];
}

static double height(const curve *c, double time, int64_t k) {
  heights(c, time, c->values);
  return c->values[k];
}

/* The end at which it is below zero of the smallest bracket of a crossing: the secant with halved sides (Illinois), and
   the middle where that does not get on. */
static double locate(const curve *c, int64_t k, double a, double b, double at_a, double at_b) {
  double wide = b - a;
  int side = 0;
  for (int call = 0; call < MOST_CALLS && b - a > 2 * TIGHT * fmax(fabs(a), fabs(b)); call++) {
    double t = a + (b - a) * (at_a / (at_a - at_b));
    if (call % 3 == 2) {
      if (b - a > 0.5 * wide) t = a + (b - a) / 2;
      wide = b - a;
    }
    const double least = TIGHT * fmax(fabs(a), fabs(b));
    t = fmin(fmax(t, a + least), b - least);
    if (!(t > a && t < b)) t = a + (b - a) / 2;
    if (!(t > a && t < b)) break;
    const double value = height(c, t, k);
    if (value < 0) {
      b = t;
      at_b = value;
      if (side < 0) at_a /= 2;
      side = -1;
    } else {
      a = t;
      at_a = value;
      if (side > 0) at_b /= 2;
      side = 1;
    }
  }
  return b;
}

/* The lowest place between two times, by golden sections, as soon as it is below zero. */
static double lowest(const curve *c, int64_t k, double a, double b, double *value) {
  double low = b - GOLDEN*(b - a), high = a + GOLDEN*(b - a), at_low = height(c, low, k), at_high = height(c, high, k);
  for (int i = 0; i < NARROWED && at_low >= 0 && at_high >= 0; i++) {
    if (at_low < at_high) {
      b = high;
      high = low;
      at_high = at_low;
      low = b - GOLDEN*(b - a);
      at_low = height(c, low, k);
    } else {
      a = low;
      low = high;
      at_low = at_high;
      high = a + GOLDEN*(b - a);
      at_high = height(c, high, k);
    }
  }
  *value = fmin(at_low, at_high);
  return at_low < at_high ? low : high;
}

static int may_dip(double before, double here, double behind) {
  return 0 < here && here <= fmin(before, behind) && here < fmax(before, behind) - here;
}

/* What the quartic through the first five of some even samples, or the last ones, gives at `BESIDE`. */
static double expected(const double *values, int64_t count, int64_t samples, int from_end) {
  const double at = BESIDE * (double)(samples - 1);
  double sum = 0;
  for (int a = 0; a < 5; a++) {
    double weight = 1;
    for (int b = 0; b < 5; b++) if (b != a) weight *= (at - b) / (a - b);
    sum += weight * values[(from_end ? samples - 1 - a : a) * count];
  }
  return sum;
}

/* Whether a function may be below zero between samples, for all these tell: where the cubic through four even ones misses
   the one in their middle by a part of what the function changes, or the quartic those beside the ends. */
static int unresolved(const double *even, const double *beside, int64_t count, int64_t samples) {
  double missed = 0, low = INFINITY, high = -INFINITY;
  for (int64_t i = 0; i < samples; i++) {
    const double *at = even + i*count;
    low = fmin(low, *at);
    high = fmax(high, *at);
    if (i < 2 || i + 2 >= samples) continue;
    missed = fmax(missed, fabs((4*(at[-count] + at[count]) - at[-2*count] - at[2*count]) / 6 - *at));
  }
  for (int from_end = 0; from_end < 2 && samples <= MANY; from_end++)
    missed = fmax(missed, fabs(beside[from_end*count] - expected(even, count, samples, from_end)));
  return missed > COARSE * (high - low) && low < 10 * missed;
}

/* Even samples, more of them where they do not tell; returns how many. Behind them stand those beside the ends. */
static int64_t sampled(const curve *c, double begin, double end, double *values) {
  for (int64_t samples = 5;; samples = 2*samples - 1) {
    double *beside = values + samples*c->count;
    const double aside = BESIDE * (end - begin);
    int more = 0;
    for (int64_t i = 0; i < samples + 2; i++) {
      const double even = begin + (end - begin) * (double)i / (double)(samples - 1);
      heights(c, i < samples - 1 ? even : i == samples - 1 ? end : i == samples ? begin + aside : end - aside,
              values + i*c->count);
      fmu_seen(c->f);
    }
    for (int64_t k = 0; k < c->count && !more; k++) more = unresolved(values + k, beside + k, c->count, samples);
    if (!more || 2*samples + 1 > FMU_SAMPLES) return samples;
  }
}

/* The first time at which function k is below zero. */
static double first_of(const curve *c, int64_t k, double begin, double end, const double *values, int64_t samples) {
  const double aside = BESIDE * (end - begin);
  double sign = 1, t[3] = {begin, begin, begin}, h[3] = {0, 0, 0};
  if (c->sides[k] == 0) { /* known by its values alone */
    for (int64_t i = 0; i < samples; i++)
      if (values[i*c->count + k] != 0) { sign = values[i*c->count + k] < 0 ? -1 : 1; break; }
    c->sides[k] = sign;
  }
  for (int64_t i = 0; i < samples + 2; i++) { /* in order of time: those beside the ends are second and last but one */
    const int64_t at = i == 1 ? samples : i == samples ? samples + 1 : i == samples + 1 ? samples - 1 : i ? i - 1 : 0;
    t[0] = t[1], t[1] = t[2], h[0] = h[1], h[1] = h[2];
    t[2] = i == 0 ? begin : i == 1 ? begin + aside : i == samples ? end - aside : i == samples + 1 ? end
           : begin + (end - begin) * (double)at / (double)(samples - 1);
    h[2] = sign * values[at*c->count + k];
    if (i > 1 && h[1] >= 0 && may_dip(h[0], h[1], h[2])) {
      double value;
      const double low = lowest(c, k, t[0], t[2], &value);
      if (value < 0) return locate(c, k, t[0], low, h[0], value);
    }
    if (h[2] < 0) return i ? locate(c, k, t[1], t[2], h[1], h[2]) : begin;
  }
  return INFINITY;
}

double fmu_first_root(fmu *f, double begin, double end, int (*states)(void *own, double time, double *x), void *own) {
  curve c = {f, states, own, fmu_roots(f), f->root, f->root + fmu_roots(f)};
  double found = INFINITY, *values = f->root + 4*c.count;
  fmu_sides(f, c.sides);
  const int64_t samples = sampled(&c, begin, end, values);
  for (int64_t k = 0; k < c.count; k++) {
    const double t = first_of(&c, k, begin, end, values, samples);
    if (t < found) found = t;
  }
  fmu_followed(f);
  return found;
}
