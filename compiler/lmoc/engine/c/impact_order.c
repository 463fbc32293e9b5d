/* Whether an impact of several laws depends on what happens first, when all of it happens at once.

   Bodies that touch are hit at the same instant. Laws for all impacts at once give one answer; impacts one after the
   other, each of two bodies, may give others, and which of them a real scene gives depends on how stiff its bodies are
   (F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter 8). Three equal balls in a
   row, of which the first one comes with velocity 1, leave with (-1/3, 2/3, 2/3) or (0, 0, 1). */

#include <math.h>

#include "impact.h"

static const double STILL = 1e-9;     /* share of the largest rate: what approaches no faster has no more impacts */
static const double DIFFERENT = 1e-6; /* the same: by which two answers are different ones */
enum { MOST = 400, FEW = 24 };        /* impacts one after the other; laws, in larger groups nothing is tried */

/* Whether rates behind impacts one after the other, of the first law in an order that approaches, are others; not where
   there is no end of them. */
static int others(int64_t n, const double *delassus, const double *before, const double *restitution, int backwards,
                  double size, const double *after) {
  double rate[FEW];
  for (int64_t k = 0; k < n; k++) rate[k] = before[k];
  for (int step = 0; step < MOST; step++) {
    int64_t hit = -1;
    for (int64_t i = 0; i < n && hit < 0; i++) {
      const int64_t k = backwards ? n - 1 - i : i;
      if (rate[k] < -STILL * size && delassus[k*n + k] > 0) hit = k;
    }
    if (hit < 0) {
      for (int64_t k = 0; k < n; k++)
        if (fabs(rate[k] - after[k]) > DIFFERENT * size) return 1;
      return 0;
    }
    const double impulse = -(1 + restitution[hit]) * rate[hit] / delassus[hit*n + hit];
    for (int64_t k = 0; k < n; k++) rate[k] += delassus[k*n + hit] * impulse;
  }
  return 0;
}

int lmoc_depends_on_order(int64_t n, const double *delassus, const double *rate, const double *restitution,
                          const double *after) {
  double size = 0;
  int coupled = 0;
  if (n < 2 || n > FEW) return 0;
  for (int64_t k = 0; k < n; k++) size = fmax(size, fabs(rate[k]));
  for (int64_t i = 0; i < n; i++)
    for (int64_t j = 0; j < n; j++) coupled |= i != j && delassus[i*n + j] != 0;
  return size > 0 && coupled && (others(n, delassus, rate, restitution, 0, size, after) ||
                                 others(n, delassus, rate, restitution, 1, size, after));
}
