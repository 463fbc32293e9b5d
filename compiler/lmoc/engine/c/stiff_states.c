/* States that go back by themselves where they are off, and what they do not tell.

   A stiff state follows what it is driven by more closely than a step is exact. So it is off by what a step may be off by,
   and goes back in no time: a level that it has just crossed it seems to cross again, the more often the steps begin
   anew. */

#include "happen.h"

static const double STIFF = 1e4;    /* times that a stiff state goes back in a run */
static const double WIDE = 10;      /* times what a step may be off by where it ends: what it may be on its way */
static const double SHORTLY = 1e-3; /* of the run, within which a function that crosses zero again may not have left it */
enum { MOST = 700 };                /* states that are moved one by one */

/* A state moved to both sides: how fast it goes back, 1/s, negative where it goes away; and `change`, (zeros,). */
static int moved(const lmoc_events *v, double time, const double *x, int64_t i, const double *rate, const double *here,
                 double *back, double *change) {
  lmoc_instant *e = v->e;
  const int64_t n = e->states;
  double *beside = v->h->work + n, *other = beside + n, *value = other + n;
  int found;
  *back = INFINITY;
  memset(change, 0, (size_t)e->zeros * sizeof(double));
  for (int side = -1; side <= 1; side += 2) {
    const double by = side * WIDE * v->errors[i];
    memcpy(beside, x, (size_t)n * sizeof(double));
    beside[i] += by;
    if ((found = v->h->motion(e, time, beside, other, value))) return found;
    const double faster = (rate[i] - other[i]) / by;
    *back = faster * 0 == 0 ? fmin(*back, faster) : -INFINITY;
    for (int64_t k = 0; k < e->zeros; k++) change[k] = fmax(change[k], fabs(value[k] - here[k]));
  }
  return LMOC_SETTLED;
}

/* What steps leave open of the zero functions, `open`, by stiff states that stand where they are driven, and by those
   whose rates are not the slopes of the way that has been found for them; and the functions, `here`. */
static int left_open(const lmoc_events *v, double time, const double *x, double *open, double *here, double *change) {
  const lmoc_instant *e = v->e;
  double *rate = v->h->work, back;
  int found;
  memset(open, 0, (size_t)e->zeros * sizeof(double));
  if ((found = v->h->motion(v->e, time, x, rate, here))) return found;
  for (int64_t i = 0; i < e->states; i++) {
    const double by = WIDE * v->errors[i];
    if ((found = moved(v, time, x, i, rate, here, &back, change))) return found;
    if (!(back * v->h->span > STIFF)) continue;
    const double off = v->defects ? v->defect[i] / back / by : 0,
                 share = fabs(rate[i]) <= back * by ? fmax(1, off) : off;
    for (int64_t k = 0; k < e->zeros; k++) open[k] += change[k] * share * 0 == 0 ? change[k] * share : 0;
  }
  return LMOC_SETTLED;
}

/* Whether a function that crosses zero has done so just before, and the motion is the same since. */
static int comes_again(const lmoc_events *v, double time, int64_t k) {
  const double since = fmax(*v->turned, time - SHORTLY * v->h->span);
  return v->which[k] != 0 && !lmoc_rounded(v->e, k) && v->h->times[(k + 1)*LMOC_CHATTER - 1] > since;
}

/* What has not been further away from zero than that is where it was, until it is so far on the other side. Where an event
   has changed the motion, that may well have sent a function back. */
int lmoc_without_noise(lmoc_events *v, double time, const double *x, int *some) {
  lmoc_instant *e = v->e;
  double *open = v->h->work + 3*e->states + e->zeros, *here = open + e->zeros, *change = here + e->zeros;
  int again = 0, found;
  for (int64_t k = 0; k < e->zeros; k++) again |= comes_again(v, time, k);
  if (!again || !v->errors || e->states > MOST) return LMOC_SETTLED;
  if (v->defects) v->defects(v);
  if ((found = left_open(v, time, x, open, here, change))) return found;
  *some = 0;
  for (int64_t k = 0; k < e->zeros; k++) {
    if (comes_again(v, time, k) && fmax(e->largest[k], fabs(here[k])) <= open[k]) {
      v->which[k] = 0;
      e->margin[k] = fmax(e->margin[k], open[k]);
    }
    *some |= v->which[k] != 0;
  }
  return LMOC_SETTLED;
}
