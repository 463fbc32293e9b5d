/* Relations: their values from those of their zero functions, and the functions whose change of sign is an event. */

#include "instant.h"

static const double ULP = 0x1p-52, SMALL = 1e-10, NOISES = 4, ROUNDING = 1e-14, FAR = 100;

int lmoc_rounded(const lmoc_instant *e, int64_t zero) { return e->op[e->of_zero[zero]] == LMOC_FLOOR; }

double lmoc_height(const lmoc_instant *e, int64_t zero, double value) {
  return fabs(lmoc_rounded(e, zero) ? value - nearbyint(value) : value);
}

double lmoc_decide(int op, double zero) { return op == LMOC_FLOOR ? floor(zero) : op == LMOC_GT ? zero > 0 : zero >= 0; }

/* The value that a zero function asks for, from where it is now: within the margin of a crossing it stays, and at the
   event that its crossing is it has the value behind it. */
static double decided(const lmoc_instant *e, int64_t zero, double now) {
  const int op = e->op[e->of_zero[zero]];
  const double value = e->zero[zero], beside = op == LMOC_FLOOR ? lmoc_max(now - value, value - now - 1) : fabs(value);
  const double kept = e->crossed[zero] != 0 ? e->crossed[zero] - 1 : now;
  return beside < e->margin[zero] ? kept : lmoc_decide(op, value);
}

/* A relation of time as it is right behind the present time, or before it; at the start as it is written. */
static double timed(const lmoc_instant *e, int64_t relation) {
  const int64_t line = -1 - e->row[relation];
  const int op = e->op[relation];
  const double slope = e->line[e->slope[line]], zero = slope*e->time + e->line[e->offset[line]],
               nearest = op == LMOC_FLOOR ? nearbyint(zero) : 0, side = e->literal ? -1 : 1;
  if (e->literal && e->early[relation] == 0) return lmoc_decide(op, e->line[e->written[line]]);
  const int at = fabs(zero - nearest) <= fabs(slope) * lmoc_near_to(e->time) && slope != 0;
  return lmoc_decide(op, at ? nearest + side * (slope > 0 ? 0.5 : -0.5) : zero);
}

void lmoc_relations(lmoc_instant *e) {
  for (int64_t r = 0; r < e->relations; r++) {
    double *target = e->v + e->target[r];
    if (e->supposing && e->supposed[r] != 0) continue;
    *target = e->row[r] < 0 ? timed(e, r) : decided(e, e->row[r], *target);
  }
}

/* ------------------------------------------------------------------ roots */

static double value_of(const lmoc_instant *e, int64_t zero) { return e->v[e->target[e->of_zero[zero]]]; }

int64_t lmoc_roots(const lmoc_instant *e) {
  int64_t count = e->zeros;
  for (int64_t k = 0; k < e->zeros; k++) count += lmoc_rounded(e, k);
  return count;
}

/* Zero functions, their margin away from zero; of a rounded one the lower edge, and behind all others the upper one. */
void lmoc_root_values(const lmoc_instant *e, const double *zero, double *out) {
  int64_t upper = e->zeros;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double now = value_of(e, k), margin = e->margin[k];
    if (lmoc_rounded(e, k)) {
      out[k] = zero[k] - now + margin;
      out[upper++] = now + 1 - zero[k] + margin;
    } else out[k] = zero[k] + (now > 0 ? margin : -margin);
  }
}

void lmoc_root_sides(const lmoc_instant *e, double *out) {
  const int64_t count = lmoc_roots(e);
  for (int64_t k = 0; k < count; k++) out[k] = k < e->zeros && !lmoc_rounded(e, k) && !(value_of(e, k) > 0) ? -1 : 1;
}

void lmoc_seen(lmoc_instant *e, const double *zero) {
  for (int64_t k = 0; k < e->zeros; k++) {
    e->high[k] = fmax(e->high[k], lmoc_height(e, k, zero[k]));
    e->largest[k] = fmax(e->largest[k], fabs(zero[k]));
  }
}

void lmoc_followed(lmoc_instant *e) {
  for (int64_t k = 0; k < e->zeros; k++) {
    if (e->high[k] > FAR * e->margin[k]) e->margin[k] = 0;  /* it has left zero, whatever comes */
    e->high[k] = 0;
  }
}

void lmoc_follow(lmoc_instant *e, int64_t count, const double *zero, double *out) {
  const int64_t roots = lmoc_roots(e);
  for (int64_t i = 0; i < count; i++) {
    lmoc_root_values(e, zero + i*e->zeros, out + i*roots);
    lmoc_seen(e, zero + i*e->zeros);
  }
  lmoc_followed(e);
}

void lmoc_turn_early(lmoc_instant *e, const double *which) {
  for (int64_t k = 0; k < e->zeros; k++) {
    double *now = e->v + e->target[e->of_zero[k]];
    const int turned = decided(e, k, *now) != *now;
    if (which[k] != 0 && !lmoc_rounded(e, k)) e->crossed[k] = 2 - *now;
    if (which[k] == 0 || turned) continue;
    *now = lmoc_rounded(e, k) ? *now + (which[k] == 2 ? 1 : -1) : 1 - *now;
    e->margin[k] = fmax(e->margin[k], fmax(2 * lmoc_height(e, k, e->zero[k]), ROUNDING * e->largest[k]));
  }
}

/* Until functions have left zero that they have just crossed, rounding does not bring them back. */
void lmoc_leave_zero(lmoc_instant *e, const double *which) {
  for (int64_t k = 0; k < e->zeros; k++) {
    if (lmoc_height(e, k, e->zero[k]) > e->margin[k]) e->margin[k] = 0;
    if (which[k] == 0) continue;
    e->margin[k] = fmax(e->margin[k], ROUNDING * e->largest[k]);
    e->largest[k] = 0;
  }
}

/* ------------------------------------------------------------------ rounding */

static double largest_of(int64_t count, const double *values) {
  double found = 0;
  for (int64_t i = 0; i < count; i++) found = fmax(found, fabs(values[i]));
  return found;
}

/* Bounds are kept as long as what they depend on is the same, the time and the largest state have not doubled or halved,
   and no state is twice as far as it has gone. */
static int holds(const lmoc_instant *e, double time, const double *x) {
  if (!e->bound_known || fabs(time) > 2*fabs(e->bound_time) || 2*fabs(time) < fabs(e->bound_time)) return 0;
  if (2*largest_of(e->states, x) < e->bound_size) return 0;
  for (int64_t i = 0; i < e->states; i++) if (fabs(x[i]) > 2*e->way[i]) return 0;
  for (int64_t i = 0; i < e->bounded; i++) if (lmoc_differ(e->v[e->read[i]], e->known[i])) return 0;
  return 1;
}

int lmoc_rounding(lmoc_instant *e, double time, const double *x) {
  if (holds(e, time, x)) return LMOC_SETTLED;
  if (e->bounds(e, time, x)) return LMOC_HALTED;
  e->bound_known = 1;
  e->bound_time = time;
  e->bound_size = largest_of(e->states, x);
  for (int64_t i = 0; i < e->states; i++) e->way[i] = fmax(e->way[i], fabs(x[i]));
  for (int64_t i = 0; i < e->bounded; i++) e->known[i] = e->v[e->read[i]];
  return LMOC_SETTLED;
}

/* Whether a function is so small that its rounding is worth a look. */
static int may_be_rounding(const lmoc_instant *e, int64_t zero, double height, double size) {
  const double terms = e->bound_known ? e->bound[zero] / ULP : 0;
  return height <= SMALL * fmax(terms, size) && !lmoc_rounded(e, zero);
}

/* Set the margins of functions that are zero but for rounding: a relation does not react to that. The acceleration of a
   wheel at rest behind open clutches is a sum that cancels, 1e-15 or -2e-15, as it comes. What is zero without a sum has
   no rounding, and no margin: the force between two teeth in their play. */
int lmoc_widen(lmoc_instant *e, double time, const double *x) {
  const double size = fmax(1, fmax(largest_of(e->states, x), largest_of(e->zeros, e->zero)));
  int some = 0;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double height = fabs(e->zero[k]);
    some |= e->near[k] = may_be_rounding(e, k, height, size) && (height > 0 || e->margin[k] > 0);
  }
  if (!some) return LMOC_SETTLED;
  if (lmoc_rounding(e, time, x)) return LMOC_HALTED;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double height = fabs(e->zero[k]), bound = e->bound[k],
                 margin = height == 0 && bound == 0 ? 0 : fmax(e->margin[k], NOISES * bound);
    if (e->near[k] && height <= margin) e->margin[k] = margin;
  }
  return LMOC_SETTLED;
}

int lmoc_quiet(lmoc_instant *e, double time, const double *x, const double *height, uint8_t *out) {
  const double size = fmax(1, fmax(largest_of(e->states, x), largest_of(e->zeros, e->zero)));
  int some = 0;
  for (int64_t k = 0; k < e->zeros; k++) some |= out[k] = may_be_rounding(e, k, height[k], size);
  if (some && lmoc_rounding(e, time, x)) return LMOC_HALTED;
  for (int64_t k = 0; k < e->zeros; k++) out[k] = out[k] && height[k] <= NOISES * e->bound[k];
  return LMOC_SETTLED;
}
