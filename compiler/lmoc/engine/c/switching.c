/* Functions whose change of sign ends a mode: gaps and forces of unilateral laws, velocities and limits of friction. */

#include "switching.h"
#include "strike.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double NEAR = 1e-10;    /* values below this share of their terms are zero up to rounding at the beginning of a
                                        segment ... */
static const double APART = 1e-13;   /* ... and have come back to zero only when they are below zero by this share ... */
static const double LEAVING = 1e-16; /* ... or by this one where they grow from zero at once */
static const double COARSER = 10;    /* times these shares behind each root at which nothing has happened */
static const double COARSEST = 13;   /* of such roots; by then all that is left of the terms is zero */

static int sticks(const lmoc_switching *s, int64_t i) { return s->closed[i] && !s->laws.complementary[i]; }

/* The limit of a friction, from what has been read. */
static double limit_of(const lmoc_switching *s, int64_t i, const double *force, const double *stick) {
  const double limit = s->limits[i] == s->limits[i] ? s->limits[i] : stick[i];
  return s->laws.normal[i] >= 0 ? limit * force[s->laws.normal[i]] : limit;
}

int64_t lmoc_law_roots(const lmoc_switching *s, int64_t count, const double *read, const double *apart, double *out) {
  const int64_t n = s->laws.count;
  int64_t size = n;
  for (int64_t i = 0; i < n; i++) size += sticks(s, i);
  for (int64_t row = 0; row < count; row++, read += 4*n, out += size) {
    const double *motion = read, *rate = read + n, *force = read + 2*n, *stick = read + 3*n;
    for (int64_t i = 0, second = n; i < n; i++) {
      if (s->laws.complementary[i]) out[i] = s->closed[i] ? force[i] : motion[i];
      else if (!s->closed[i]) out[i] = (double)s->direction[i] * rate[i];
      else {
        const double limit = limit_of(s, i, force, stick);
        out[i] = limit - force[i];
        out[second++] = limit + force[i];
      }
      if (s->implied[i] && !s->closed[i]) out[i] = 1; /* others hold these at rest, up to rounding */
    }
    for (int64_t i = 0; i < size && apart; i++) out[i] += apart[i];
  }
  return size;
}

/* The size of the terms of a function: of a gap, a rate, or of what a closed law holds. */
static double terms_of(const lmoc_switching *s, const lmoc_contact *now, int64_t i) {
  const double stick = now->stick[i];
  if (!s->closed[i]) return s->unilateral[i] ? now->gap_scale[i] : now->rate_scale[i];
  const double held = fabs(now->bias[i] / now->delassus[i * s->laws.count + i]) + (stick == stick ? fmin(stick, DBL_MAX) : 0);
  return held * 0 == 0 ? held : 0;
}

/* Of the force of what is closed without a load. */
static double rounding_of(const lmoc_switching *s, const lmoc_contact *now, int64_t i) {
  if (!s->closed[i] || !(fabs(now->bias[i]) <= s->noise[i])) return 0;
  const double force = s->noise[i] / now->delassus[i * s->laws.count + i];
  return force * 0 == 0 ? force : 0;
}

/* A gap that opens with a velocity begins at zero and grows. What has not been touched counts to the last digit: near the
   end of its bounces a body rises by less than any share of the lengths around. Values between long steps of equal length
   are known less well: a gap that opens with the third power of time seems to close at once. Where nothing happens at such
   a root, the next one has to be farther from zero. */
void lmoc_law_apart(const lmoc_switching *s, const lmoc_contact *now, const double *errors, const double *values,
                    double *apart) {
  for (int64_t i = 0, second = s->laws.count; i < s->laws.count; i++) {
    const int leaves = s->unilateral[i] && !s->closed[i] && now->rate[i] > LMOC_STILL * now->rate_scale[i];
    const double terms = terms_of(s, now, i), rounding = rounding_of(s, now, i),
                 coarser = pow(COARSER, fmin(s->idle[i], COARSEST)),
                 share = fmax((leaves && s->idle[i] == 0 ? LEAVING : APART * coarser) * terms, rounding);
    double near = fmax(NEAR * coarser * terms, rounding), drifted;
    if (s->curved[i] && s->touched[i] && !s->closed[i]) {
      lmoc_drift(1, s->states, now->slope + i * s->states, errors, &drifted);
      near = fmax(near, drifted);
    }
    const int concerned = s->closed[i] || s->touched[i] || s->idle[i] > 0;
    apart[i] = concerned && fabs(values[i]) <= near ? fmax(-values[i], 0) + share : 0;
    if (!sticks(s, i)) continue;
    apart[second] = fabs(values[second]) <= near ? fmax(-values[second], 0) + share : 0;
    second++;
  }
}
