/* Sign changes within a step: on the step's own dense output, in order.

   Between the ends of a step a function may cross zero and come back. It is therefore looked at inside as well, more
   closely where the samples do not tell how it goes, and where it comes near zero and turns, at its extremum (Shampine &
   Thompson, Event location for ordinary differential equations, Comput. Math. Appl. 39, 2000). */

#include "roots.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double BESIDE = 0.01;  /* of a step: also looked at that close to its ends. Where a function turns there, the
                                       samples further inside do not tell */
static const double COARSE = 0.02;  /* of a function's change in a step: what samples may be off by that follow it */
static const double LOW = 0.02;     /* of what three samples differ by: below it a minimum between may be below zero */
static const double APART = 16;     /* units of the last digit of time: samples that are closer show rounding */
static const double SHORTEST = 1.0 / 512; /* of a step, a part */
enum {
  FEW = 5,                          /* samples at equal distances, to begin with */
  MANY = 65,                        /* in a part of a step; where more are needed, the part is made shorter */
  MOST = 500,                       /* in a step, where no part is short enough */
  TOGETHER = 20                     /* at which functions are looked at to find a crossing */
};

static double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : x; }

/* ------------------------------------------------------------------ memory */

/* Of a part with so many samples at equal distances, and those beside the ends. */
static int reserve(lmoc_finder *f, int64_t inside) {
  const int64_t rows = inside + 2, room = rows * (f->count + 2) + (TOGETHER + 1) * f->count;
  if (room <= f->room) return 0;
  free(f->memory);
  f->memory = malloc(room * sizeof(double));
  f->room = f->memory ? room : 0;
  return f->memory ? 0 : LMOC_ROOTS_NO_MEMORY;
}

void lmoc_roots_free(lmoc_finder *f) {
  free(f->memory);
  f->memory = 0;
  f->room = 0;
}

/* Where things stand in it. */
static double *times_of(const lmoc_finder *f) { return f->memory; }
static double *lowest_of(const lmoc_finder *f) { return f->memory + f->inside + 2; }
static double *samples_of(const lmoc_finder *f) { return f->memory + 2*(f->inside + 2); }
static double *here_of(const lmoc_finder *f) { return samples_of(f) + (f->inside + 2) * f->count; }
static double *sides_of(const lmoc_finder *f) { return here_of(f) + TOGETHER * f->count; }

/* ------------------------------------------------------------------ what samples tell */

/* What the quartic through the first five of some even samples, or the last ones, gives at `BESIDE`. */
static double expected(const double *first, int64_t stride, int64_t inside) {
  const double at = BESIDE * (double)(inside - 1);
  double sum = 0;
  for (int a = 0; a < 5; a++) {
    double weight = 1;
    for (int b = 0; b < 5; b++) if (b != a) weight *= (at - b) / (a - b);
    sum += weight * first[a * stride];
  }
  return sum;
}

/* Whether a function may be below zero somewhere between samples, for all these tell: where the cubic through four even
   neighbours misses the one in their middle by a part of what the function changes, or the quartic those beside the ends.
   So does that of an oscillation of nearly as many periods as samples. */
static int unresolved(const lmoc_finder *f, int64_t k, double *even) {
  const int64_t m = f->count, n = f->inside;
  const double *samples = samples_of(f) + k, side = f->signs[k];
  double missed = 0, low = INFINITY, high = -INFINITY, height = INFINITY, check = 0;
  for (int64_t i = 0; i < n; i++) {
    const double value = even[i] = samples[(i == 0 ? 0 : i == n - 1 ? n + 1 : i + 1) * m];
    check += value * 0;
    low = fmin(low, value);
    high = fmax(high, value);
    height = fmin(height, value * side);
  }
  for (int64_t i = 2; i + 2 < n; i++)
    missed = fmax(missed, fabs(even[i] - (4*(even[i - 1] + even[i + 1]) - even[i - 2] - even[i + 2]) / 6));
  if (n <= MANY) {
    missed = fmax(missed, fabs(samples[m] - expected(even, 1, n)));
    missed = fmax(missed, fabs(samples[n * m] - expected(even + n - 1, -1, n)));
    check += (samples[m] + samples[n * m]) * 0;
  }
  return check == 0 && missed > COARSE * (high - low) && height < 10 * missed;
}

/* The minimum of the parabola through three samples: its place as a share, NaN for none, and its value. */
static double vertex(const double *times, const double *heights, double *value) {
  const double share = (times[1] - times[0]) / (times[2] - times[0]), slope = (heights[1] - heights[0]) / share,
               bent = (heights[2] - heights[0] - slope) / (1 - share), at_first = slope - share * bent;
  *value = heights[0] - at_first * at_first / (4 * bent);
  return bent > 0 ? -at_first / (2 * bent) : NAN;
}

/* Whether a smooth function may be below zero between three samples that are not: where it has turned and is no higher
   than it has come down, or where their parabola comes near zero: as of a hop that is over in a small part of a long
   step, at whose samples all is as before. Else it would take a curvature that the samples do not show. */
static int dips(const double *times, const double *h) {
  if (h[1] > 0 && h[1] <= h[0] && h[1] <= h[2] && (2*h[1] < h[0] || 2*h[1] < h[2])) return 1;
  const double least = fmin(fmin(h[0], h[2]), h[1]), most = fmax(fmax(h[0], h[2]), h[1]);
  if (!(least >= 0)) return 0;
  double value;
  const double place = vertex(times, h, &value);
  return place > 0 && place < 1 && value < LOW * (most - least) && value < least;
}

/* ------------------------------------------------------------------ samples */

/* Functions that are zero but for rounding keep their sign. */
static int without_rounding(lmoc_finder *f) {
  const int64_t m = f->count, rows = f->inside + 2;
  double *samples = samples_of(f), *heights = here_of(f);
  uint8_t *wrong = f->which, *out = (uint8_t *)(heights + m);
  int some = 0, halted;
  if (!f->quiet) return 0;
  for (int64_t k = 0; k < m; k++) {
    wrong[k] = (uint8_t)unresolved(f, k, lowest_of(f));
    heights[k] = 0;
    for (int64_t i = 0; i < rows; i++) {
      const double value = samples[i*m + k];
      wrong[k] |= value * f->signs[k] <= 0;
      if (!(fabs(value) <= heights[k])) heights[k] = fabs(value);
    }
    some |= wrong[k];
  }
  if (!some) return 0;
  if ((halted = f->quiet(f->owner, times_of(f)[rows - 1], heights, out))) return halted;
  for (int64_t k = 0; k < m; k++)
    for (int64_t i = 0; i < rows && wrong[k] && out[k]; i++) samples[i*m + k] = f->signs[k] * heights[k];
  return 0;
}

static int some_unresolved(const lmoc_finder *f) {
  for (int64_t k = 0; k < f->count; k++) if (unresolved(f, k, lowest_of(f))) return 1;
  return 0;
}

/* Times from `begin` on, and the functions there, close enough to follow them.

   They reach to the end of the step, or of a part of it where the functions change too often in all of it: a step is as
   long as the states allow, and they say nothing about a body that is held fast, while the force that holds it follows
   the load. After a root, the rest of the step is looked at as closely as before it. Of a step of a few units of the last
   digit of time, as before a stop at an event, more samples show rounding alone. */
static int sample(lmoc_finder *f) {
  for (int halted;;) {
    if ((halted = reserve(f, f->inside))) return halted;
    const int64_t n = f->inside;
    const double begin = f->begin, end = begin + 1.01 * f->length < f->end ? fmin(begin + f->length, f->end) : f->end;
    double *times = times_of(f);
    for (int64_t i = 0; i < n + 2; i++) {
      const double share = i == 1 ? BESIDE : i == n ? 1 - BESIDE : (double)(i ? i - 1 : 0) / (double)(n - 1);
      times[i] = begin + share * (end - begin);
    }
    times[n + 1] = end;
    if ((halted = f->values(f->owner, n + 2, times, samples_of(f))) || (halted = without_rounding(f))) return halted;
    const double digit = fmax(fabs(begin), fabs(end)), apart = nextafter(digit, INFINITY) - digit;
    if (n > MOST || !(end - begin > (double)n * APART * apart) || !some_unresolved(f)) return 0;
    if (n >= MANY && f->length < INFINITY) {
      /* a part, or all of the step again where not even the shortest is followed: a jump, or noise */
      f->length = fmin(f->length, end - begin) / 2;
      if (!(f->length < f->shortest)) continue;
      f->length = INFINITY;
    }
    f->inside = 2*n - 1;
  }
}

/* ------------------------------------------------------------------ one function, or the lowest of several */

/* The lowest of the functions that have a side, above it. */
static int lowest_height(void *own, int64_t count, const double *times, double *values) {
  lmoc_finder *f = own;
  const int64_t m = f->count;
  const double *sides = sides_of(f);
  double *here = here_of(f);
  const int halted = f->values(f->owner, count, times, here);
  for (int64_t i = 0; i < count && !halted; i++) {
    values[i] = INFINITY;
    for (int64_t k = 0; k < m; k++) {
      const double height = here[i*m + k] * sides[k];
      if (sides[k] != 0 && !(height >= values[i])) values[i] = height;
    }
  }
  return halted;
}

/* Whether function k may be below zero between samples, and the first one at which it is; all of them: none. */
static int64_t first_below(const lmoc_finder *f, int64_t k, int *may_dip) {
  const int64_t m = f->count, rows = f->inside + 2;
  const double *times = times_of(f), *samples = samples_of(f) + k, side = f->signs[k];
  double h[3] = {0, 0, 0};
  int64_t found = rows;
  *may_dip = 0;
  for (int64_t i = 0; i < rows; i++) {
    h[0] = h[1], h[1] = h[2], h[2] = samples[i*m] * side;
    if (h[2] < 0 && found == rows) found = i;
    if (i > 1 && !*may_dip) *may_dip = dips(times + i - 2, h);
  }
  return found;
}

/* The first root of the functions that simply cross zero, as that of the lowest of them: which one, -1 for none. `which`
   gets those that are to be looked at one by one. */
static int together(lmoc_finder *f, double *time, int64_t *who) {
  const int64_t m = f->count, rows = f->inside + 2;
  double *sides = sides_of(f), *lowest = lowest_of(f), *times = times_of(f), *here = here_of(f);
  int64_t first = rows, many = 0;
  int halted, in_order = 1;
  *who = -1;
  for (int64_t k = 0; k < m; k++) {
    int may_dip;
    const int64_t below = first_below(f, k, &may_dip);
    const int is_simple = below < rows && !may_dip;
    f->which[k] = !is_simple && (may_dip || f->signs[k] == 0);
    sides[k] = is_simple ? (double)below : INFINITY;
    if (is_simple && below < first) first = below;
  }
  if (first == rows) return 0;
  for (int64_t k = 0; k < m; k++) {
    const int counts = sides[k] == (double)first;
    sides[k] = counts ? f->signs[k] : 0;
    many += counts;
    if (counts && *who < 0) *who = k;
  }
  *time = times[0];
  if (first == 0) return 0; /* against the sign it is said to have: at once */
  for (int64_t i = 0; i < rows; i++) {
    lowest[i] = INFINITY;
    in_order &= i == 0 || times[i] > times[i - 1];
    for (int64_t k = 0; k < m; k++)
      if (sides[k] != 0 && !(samples_of(f)[i*m + k] * sides[k] >= lowest[i])) lowest[i] = samples_of(f)[i*m + k] * sides[k];
  }
  if ((halted = lmoc_locate(lowest_height, f, times[first - 1], times[first], lowest[first - 1], lowest[first],
                            in_order ? rows : 0, times, lowest, time)) || many == 1) return halted;
  if ((halted = f->values(f->owner, 1, time, here))) return halted;
  for (int64_t k = 0; k < m; k++)
    if (sides[k] != 0 && here[k] * sides[k] < here[*who] * sides[*who]) *who = k;
  return 0;
}

/* Where function k is below zero between three samples: `value` of the least that has been found. */
static int lowest_of_three(lmoc_finder *f, const double *times, const double *heights, double *time, double *value) {
  double ignored;
  const double share = vertex(times, heights, &ignored);
  if (share > 0 && share < 1) {
    *time = times[0] + share * (times[2] - times[0]);
    const int halted = lowest_height(f, 1, time, value);
    if (halted || *value < 0) return halted;
  }
  return lmoc_lowest(lowest_height, f, times[0], times[2], time, value);
}

/* The first time at which function k has the other sign than before, infinity where it keeps its sign. */
static int first_of(lmoc_finder *f, int64_t k, double *time) {
  const int64_t m = f->count, rows = f->inside + 2;
  const double *times = times_of(f), *samples = samples_of(f) + k;
  double *sides = sides_of(f), side = f->signs[k];
  for (int64_t i = 0; i < rows && side == 0; i++) side = sign(samples[i*m]);
  memset(sides, 0, m * sizeof(double));
  sides[k] = side;
  *time = INFINITY;
  if (side == 0) return 0;
  if (samples[0] * side < 0) { /* against the sign it is said to have: at once */
    *time = times[0];
    return 0;
  }
  for (int64_t i = 1; i < rows; i++) {
    double h[3] = {samples[(i - 1)*m] * side, samples[i*m] * side, i + 1 < rows ? samples[(i + 1)*m] * side : 0}, low, value;
    if (h[1] < 0) return lmoc_locate(lowest_height, f, times[i - 1], times[i], h[0], h[1], 0, 0, 0, time);
    if (i + 1 == rows || !dips(times + i - 1, h)) continue;
    const int halted = lowest_of_three(f, times + i - 1, h, &low, &value);
    if (halted) return halted;
    if (value < 0) return lmoc_locate(lowest_height, f, times[i - 1], low, h[0], value, 0, 0, 0, time);
  }
  return 0;
}

/* ------------------------------------------------------------------ roots */

/* Whether there is a root in the part that has been looked at, and which function has it. */
static int first_root(lmoc_finder *f, double *time, int64_t *who) {
  double own;
  int halted = together(f, time, who);
  for (int64_t k = 0; k < f->count && !halted; k++) {
    if (!f->which[k]) continue;
    halted = first_of(f, k, &own);
    if (own < INFINITY && (*who < 0 || own < *time)) *time = own, *who = k;
  }
  return halted;
}

void lmoc_roots_of_step(lmoc_finder *f, double before, double end) {
  f->before = f->begin = before;
  f->end = end;
  f->length = end - before;
  f->shortest = SHORTEST * f->length;
  f->inside = FEW;
}

int lmoc_next_root(lmoc_finder *f, double *time) {
  for (int64_t who;;) {
    int halted;
    if ((halted = sample(f)) || (halted = first_root(f, time, &who))) return halted;
    const double *last = samples_of(f) + (f->inside + 1) * f->count, end = times_of(f)[f->inside + 1];
    if (who < 0) {
      for (int64_t k = 0; k < f->count; k++) if (last[k] != 0) f->signs[k] = sign(last[k]);
      if (!(end < f->end)) return LMOC_NO_ROOT;
      f->begin = end;
      f->length *= 2*f->inside < MANY ? 2 : 1; /* where few samples have done */
      f->inside = FEW;
      continue;
    }
    if (*time != end) {
      last = here_of(f);
      if ((halted = f->values(f->owner, 1, time, here_of(f)))) return halted;
    }
    for (int64_t k = 0; k < f->count; k++) {
      const double now = sign(last[k]);
      f->which[k] = now * f->signs[k] < 0 || k == who;
      if (f->signs[k] == 0) f->signs[k] = now;
      else if (f->which[k]) f->signs[k] = -f->signs[k];
    }
    f->begin = *time;
    return LMOC_ROOT;
  }
}
