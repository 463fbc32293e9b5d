/* How high a zero function that is at zero rises before it comes back, by its slope and its curvature.

   Along the motion z(t + s) = z + z's + z''s^2/2: where the curvature is against the slope, the function is back after
   -2z'/z'' and has been as high as z'^2/(2|z''|). Both derivatives are central differences, the slope along the tangent of
   the motion, so that what does not move has a slope of exactly zero; the curvature along its parabola. */

#include "hops.h"

static const double MOMENT = 1e-9;  /* of the run, within which as many changes are chattering */
static const double SEEN = 200;     /* times what its zero may be off, which a hop is higher than; a margin ends at 100
                                       times itself */
static const double SHORT = 1e-6, SHORTLY = 1e-2; /* of the time since a function has last crossed zero, over which its way
                                       is looked at */
static const double EARLY = 0.125;  /* of the time to the way back, before which a function does not come back */
static const double STOPPED = 1e-3; /* of the speed with which a function has come to zero, below which it has stopped */
static const double NOISES = 4;     /* times the bound for its rounding, within which a function is zero */
static const double ULPS = 4 * 0x1p-52; /* of the largest state: rounding where no bounds are known */

int64_t lmoc_cross(const lmoc_instant *e, lmoc_hops *h, double time, const double *which) {
  const double moment = MOMENT * fmax(h->span, lmoc_near_to(time));
  int64_t busy = -1;
  h->soon = INFINITY;
  for (int64_t k = 0; k < e->zeros; k++) {
    double *times = h->times + k*LMOC_CHATTER;
    if (which[k] == 0) continue;
    memmove(times, times + 1, (LMOC_CHATTER - 1) * sizeof(double));
    times[LMOC_CHATTER - 1] = time;
    if (busy < 0 && time - times[0] <= moment) busy = k;
  }
  return busy;
}

/* s, over which the ways of some functions that are crossing zero are looked at; 0 where they have done so just before. */
static double short_time(const lmoc_instant *e, const lmoc_hops *h, double time, const double *which) {
  double last = h->begin;
  for (int64_t k = 0; k < e->zeros; k++)
    if (which[k] != 0) last = fmax(last, h->times[k*LMOC_CHATTER + LMOC_CHATTER - 2]);
  return time > last ? fmin(fmax(h->step, SHORT * (time - last)), SHORTLY * (time - last)) : 0;
}

/* Slopes of the zero functions from states on, and the time after which they are at zero again; infinity: never. */
static int ways(lmoc_instant *e, lmoc_hops *h, double time, const double *from, double by, double *slope, double *back) {
  const int64_t n = e->states, zeros = e->zeros;
  double *rate = h->work, *bend = rate + n, *x = bend + n, *other = x + n, *bent = other + n, *value = bent + zeros;
  int found;
  if ((found = h->motion(e, time, from, rate, value))) return found;
  for (int64_t i = 0; i < n; i++) bend[i] = 0;
  for (int64_t k = 0; k < zeros; k++) { slope[k] = 0; bent[k] = -2 * value[k]; }
  for (int side = -1; side <= 1; side += 2) {
    for (int64_t i = 0; i < n; i++) x[i] = from[i] + side * by * rate[i];
    if ((found = h->motion(e, time + side * by, x, other, value))) return found;
    for (int64_t i = 0; i < n; i++) bend[i] += side * other[i] / (2 * by);
    for (int64_t k = 0; k < zeros; k++) slope[k] += side * value[k] / (2 * by);
  }
  for (int side = -1; side <= 1; side += 2) {
    for (int64_t i = 0; i < n; i++) x[i] = from[i] + side * by * rate[i] + by * by / 2 * bend[i];
    if ((found = h->motion(e, time + side * by, x, other, value))) return found;
    for (int64_t k = 0; k < zeros; k++) bent[k] += value[k];
  }
  for (int64_t k = 0; k < zeros; k++) {
    const double curvature = bent[k] / (by * by);
    back[k] = slope[k] * curvature < 0 ? -2 * slope[k] / curvature : INFINITY;
  }
  return LMOC_SETTLED;
}

static double largest(const lmoc_instant *e, const double *x) {
  double found = 0;
  for (int64_t i = 0; i < e->states; i++) found = fmax(found, fabs(x[i]));
  return found;
}

static int is_up(const lmoc_instant *e, int64_t k) { return e->v[e->target[e->of_zero[k]]] > 0; }

/* Whether a function moves behind a jump of states: by more than rounding, or as a part of its way before. What a jump
   has stopped does not, though rounding may leave it some speed. `low` (zeros,) are those that matter. */
static int some_move(lmoc_instant *e, lmoc_hops *h, double time, const double *before, const double *x, const double *low,
                     const double *slope, double *past, double *back, int *some) {
  const double by = short_time(e, h, time, low), size = fmax(largest(e, x), largest(e, before));
  int found;
  *some = 0;
  if (e->bounds && (found = lmoc_rounding(e, time, x))) return found;
  if ((found = ways(e, h, time, before, by, past, back))) return found;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double noise = e->bounds ? NOISES * e->bound[k] : ULPS * size, way = fabs(slope[k]);
    *some |= low[k] != 0 && (way > noise / by || way > STOPPED * fabs(past[k]));
  }
  return LMOC_SETTLED;
}

/* Which functions rise so high, less what their zeros may be off, that this is not rounding. */
static int tells(lmoc_instant *e, double time, const double *before, const double *x, const double *height,
                 uint8_t *quiet) {
  const double size = fmax(largest(e, x), largest(e, before));
  if (e->bounds) return lmoc_quiet(e, time, x, height, quiet);
  for (int64_t k = 0; k < e->zeros; k++) quiet[k] = !(height[k] > ULPS * size);
  return LMOC_SETTLED;
}

int lmoc_turned_back(lmoc_instant *e, lmoc_hops *h, double time, const double *before, const double *x,
                     const double *which, const double *at, double *turn) {
  double *slope = h->work + 4*e->states + 2*e->zeros, *back = slope + e->zeros, *past = back + e->zeros,
         *other = past + e->zeros, *off = other + e->zeros, *height = off + e->zeros;
  uint8_t *quiet = (uint8_t *)(height + e->zeros);
  int found, low = 0, moving = 0;
  if ((found = lmoc_take(e, time, x))) return found;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double now = e->zero[k];
    const int stays = fabs(now) <= e->margin[k] || 2 * fabs(now - at[k]) <= fabs(at[k]);
    turn[k] = which[k] != 0 && !lmoc_rounded(e, k) && stays;
    low |= turn[k] != 0;
  }
  const double by = low ? short_time(e, h, time, turn) : 0;
  low = 0;
  if (!(by > 0)) {
    for (int64_t k = 0; k < e->zeros; k++) turn[k] = 0;
    return LMOC_SETTLED;
  }
  if ((found = ways(e, h, time, x, by, slope, back))) return found;
  for (int64_t k = 0; k < e->zeros; k++) {
    off[k] = fmax(2 * fabs(at[k]), fabs(slope[k]) * lmoc_near_to(time));
    height[k] = fabs(slope[k]) * back[k] / 4 / SEEN - off[k];
    turn[k] = turn[k] != 0 && slope[k] * 0 == 0 && slope[k] != 0 && (slope[k] > 0) != is_up(e, k);
  }
  if ((found = tells(e, time, before, x, height, quiet))) return found;
  for (int64_t k = 0; k < e->zeros; k++) {
    height[k] = turn[k] != 0 && quiet[k]; /* too low, perhaps */
    low |= height[k] != 0;
    turn[k] = turn[k] != 0 && !quiet[k];
  }
  if (low && (found = some_move(e, h, time, before, x, height, slope, past, other, &moving))) return found;
  for (int64_t k = 0; k < e->zeros; k++) {
    if (moving) turn[k] = height[k];
    if (moving || turn[k] == 0) continue;
    h->home[k] = time + EARLY * back[k];
    h->soon = fmin(h->soon, back[k]);
    e->margin[k] = off[k];
  }
  return moving ? LMOC_TOO_LOW : LMOC_SETTLED;
}

int lmoc_wrong_way(lmoc_instant *e, lmoc_hops *h, double time, const double *x, const double *which, double *wrong) {
  double *slope = h->work + 4*e->states + 2*e->zeros, *back = slope + e->zeros;
  int some = 0, found;
  for (int64_t k = 0; k < e->zeros; k++) {
    wrong[k] = which[k] != 0 && time < h->home[k];
    some |= wrong[k] != 0;
  }
  const double by = some ? short_time(e, h, time, wrong) : 0;
  if (by > 0 && (found = ways(e, h, time, x, by, slope, back))) return found;
  some = 0;
  for (int64_t k = 0; k < e->zeros; k++) {
    wrong[k] = by > 0 && wrong[k] != 0 && slope[k] != 0 && (slope[k] > 0) == is_up(e, k);
    some |= wrong[k] != 0;
  }
  return some ? LMOC_TOO_LOW : LMOC_SETTLED;
}
