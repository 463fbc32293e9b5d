/* Zero functions that a jump of states sends back to the side that they came from, and how high they rise before they
   come back: the rules of `numerics/events/hops.py` and `excursion.py`. */

#include "discrete.h"

#include <stdio.h>

static const double SEEN = 200, SHORTLY = 1e-2, EARLY = 0.125, STOPPED = 1e-3, ULPS = 4 * 0x1p-52;

/* s, when a function that is crossing zero now has last done so before. */
static double crossed_before(const fmu *f, int64_t k) {
  return fmax(f->times[k*FMU_CHATTER + FMU_CHATTER - 2], f->now.begin);
}

/* Slopes of the zero functions from states on, and the time after which they are at zero again; infinity: never. */
static int ways(fmu *f, const double *from, double by, double *slope, double *back) {
  const int64_t n = f->model->states, zeros = f->e.zeros;
  const double t = f->now.time;
  double *rate = f->ways, *bend = rate + n, *x = bend + n, *bent = f->noise;
  if (fmu_look(f, t, from)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < n; i++) { rate[i] = f->w[RIGHT][f->model->derivative[i]]; bend[i] = 0; }
  for (int64_t k = 0; k < zeros; k++) { slope[k] = 0; bent[k] = -2 * fmu_value(f, k); }
  for (int side = -1; side <= 1; side += 2) {
    for (int64_t i = 0; i < n; i++) x[i] = from[i] + side * by * rate[i];
    if (fmu_look(f, t + side * by, x)) return FMU_NO_VALUE;
    for (int64_t i = 0; i < n; i++) bend[i] += side * f->w[RIGHT][f->model->derivative[i]] / (2 * by);
    for (int64_t k = 0; k < zeros; k++) slope[k] += side * fmu_value(f, k) / (2 * by);
  }
  for (int side = -1; side <= 1; side += 2) {
    for (int64_t i = 0; i < n; i++) x[i] = from[i] + side * by * rate[i] + by * by / 2 * bend[i];
    if (fmu_look(f, t + side * by, x)) return FMU_NO_VALUE;
    for (int64_t k = 0; k < zeros; k++) bent[k] += fmu_value(f, k);
  }
  for (int64_t k = 0; k < zeros; k++) {
    const double curvature = bent[k] / (by * by);
    back[k] = slope[k] * curvature < 0 ? -2 * slope[k] / curvature : INFINITY;
  }
  return FMU_GOOD;
}

static int too_low(fmu *f, int64_t k) {
  char text[400];
  snprintf(text, sizeof text, "%.300s switches back and forth: its next hop is too low to be told from none",
           f->model->events.texts[f->e.of_zero[k]]);
  return fmu_refused(f, text);
}

static int is_up(const fmu *f, int64_t k) { return f->e.v[f->e.target[f->e.of_zero[k]]] > 0; }

int fmu_turned_back(fmu *f, const double *which, const double *at, double *turn, int *some) {
  lmoc_instant *e = &f->e;
  const int64_t n = f->model->states;
  const double t = f->now.time;
  double *slope = f->ways + 3*n + e->zeros, *back = slope + e->zeros, *past = back + e->zeros, *other = past + e->zeros;
  double last = -INFINITY, size = 0;
  if (lmoc_take(e, t, f->x)) return FMU_GOOD;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double now = e->zero[k];
    const int stays = fabs(now) <= e->margin[k] || 2 * fabs(now - at[k]) <= fabs(at[k]);
    turn[k] = which[k] != 0 && !lmoc_rounded(e, k) && stays;
    if (turn[k] != 0) last = fmax(last, crossed_before(f, k));
  }
  const double by = SHORTLY * (t - last);
  if (!(by > 0) || !(last > -INFINITY)) return FMU_GOOD;
  if (ways(f, f->before, by, past, other) || ways(f, f->x, by, slope, back)) return FMU_GOOD;
  for (int64_t i = 0; i < n; i++) size = fmax(size, fmax(fabs(f->x[i]), fabs(f->before[i])));
  for (int64_t k = 0; k < e->zeros; k++) {
    const double place = fmax(2 * fabs(at[k]), fabs(slope[k]) * lmoc_near_to(t));
    if (turn[k] == 0) continue;
    turn[k] = 0;
    if (slope[k] == 0 || (slope[k] > 0) == is_up(f, k)) continue;
    if (fabs(slope[k]) * back[k] / 4 > SEEN * fmax(place, ULPS * size)) {
      e->margin[k] = place;
      f->home[k] = t + EARLY * back[k];
      turn[k] = *some = 1;
    } else if (fabs(slope[k]) > fmax(ULPS * size / by, STOPPED * fabs(past[k]))) return too_low(f, k);
  }
  return FMU_GOOD;
}

int fmu_wrong_way(fmu *f, const double *which) {
  const int64_t n = f->model->states;
  double *slope = f->ways + 3*n + f->e.zeros, *back = slope + f->e.zeros;
  for (int64_t k = 0; k < f->e.zeros; k++) {
    const double by = SHORTLY * (f->now.time - crossed_before(f, k));
    if (which[k] == 0 || !(f->now.time < f->home[k]) || !(by > 0)) continue;
    if (!ways(f, f->x, by, slope, back) && slope[k] != 0 && (slope[k] > 0) == is_up(f, k)) return too_low(f, k);
  }
  return FMU_GOOD;
}
