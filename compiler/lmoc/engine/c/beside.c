/* Looking beside a place. */

#include "beside.h"

static const double ULP = 0x1p-52, ZERO = 1e-10, NOISES = 32;
static const double ASIDE = 1e-4;      /* of a state: how far it is moved to see what follows from it */
static const double FOLLOWS = 1e-9;    /* of the largest change: less is rounding */
enum { CORRECTIONS = 60, HALVINGS = 40 };

/* ------------------------------------------------------------------ rounding */

/* The functions a rounding beside a place, in time as well or not; in a moment or its opposite for every other state. */
static int look_beside(lmoc_instant *e, double time, const double *x, int alternating, int additive, double *beside) {
  for (int64_t i = 0; i < e->states; i++) {
    const double by = (alternating && i % 2 == 0 ? -1 : 1) * ULP;
    beside[i] = additive ? x[i] + by * fmax(fabs(x[i]), 1) : x[i] * (1 + by);
  }
  return e->look(e, additive ? time + ULP * fmax(fabs(time), 1) : time, beside);
}

int lmoc_widen_beside(lmoc_instant *e, double time, const double *x, double *work) {
  double *noise = work, *stays = noise + e->zeros, *here = stays + e->zeros, *beside = here + e->zeros, size = 1;
  int some = 0;
  for (int64_t i = 0; i < e->states; i++) size = fmax(size, fabs(x[i]));
  for (int64_t k = 0; k < e->zeros; k++) size = fmax(size, fabs(e->zero[k]));
  for (int64_t k = 0; k < e->zeros; k++) {
    const double h = fabs(here[k] = e->zero[k]);
    noise[k] = h <= ZERO*size && (h > 0 || e->margin[k] > 0) && !lmoc_rounded(e, k) ? 0 : -1;
    stays[k] = h == 0;
    some |= noise[k] == 0;
  }
  if (!some) return LMOC_SETTLED;
  for (int alternating = 0; alternating < 2; alternating++)
    for (int additive = 0; additive < 2; additive++) {
      if (look_beside(e, time, x, alternating, additive, beside)) return LMOC_NO_VALUE;
      for (int64_t k = 0; k < e->zeros; k++) {
        if (additive) stays[k] *= e->zero[k] == 0;
        else if (noise[k] >= 0) noise[k] = fmax(noise[k], fabs(e->zero[k] - here[k]));
      }
    }
  for (int64_t k = 0; k < e->zeros; k++)
    if (noise[k] >= 0) e->margin[k] = stays[k] != 0 ? 0 : fmax(e->margin[k], NOISES * noise[k]);
  return e->look(e, time, x);
}

/* ------------------------------------------------------------------ reinit */

static double aside(double value) { return value == 0 ? ASIDE : value * (1 + ASIDE); }

/* The variable as a function of one state. */
typedef struct {
  lmoc_instant *e;
  double (*seen)(lmoc_instant *e, const double *x, int64_t reinit);
  double *x;
  int64_t reinit, state;
} line;

static double at(const line *l, double value) {
  const double kept = l->x[l->state];
  l->x[l->state] = value;
  const double found = l->seen(l->e, l->x, l->reinit);
  l->x[l->state] = kept;
  return found;
}

/* Which state it follows from; LMOC_NOT_ONE where that is not one. */
static int the_one(line *l, double here, double *change) {
  const int64_t n = l->e->states;
  double largest = 0;
  int64_t followed = 0, one = 0;
  for (int64_t k = 0; k < n; k++) {
    l->state = k;
    change[k] = fabs(at(l, aside(l->x[k])) - here);
    if (change[k] * 0 == 0) largest = fmax(largest, change[k]);
  }
  for (int64_t k = 0; k < n; k++)
    if (!(change[k] <= FOLLOWS * largest)) { followed++; one = k; }
  l->state = one;
  return followed == 1 && here * 0 == 0 ? LMOC_MOVED : LMOC_NOT_ONE;
}

int lmoc_move_one(lmoc_instant *e, double (*seen)(lmoc_instant *e, const double *x, int64_t reinit), const double *from,
                  int64_t reinit, double wanted, double *moved, double *work) {
  line l = {e, seen, work, reinit, 0};
  if (!e->states) return LMOC_NOT_ONE;
  memcpy(work, from, (size_t)e->states * sizeof(double));
  const double here = seen(e, work, reinit);
  if (the_one(&l, here, work + e->states)) return LMOC_NOT_ONE;
  double now = work[l.state], missed = here - wanted;
  for (int k = 0; k < CORRECTIONS; k++) {
    const double beside = aside(now);
    double step = -missed * (beside - now) / (at(&l, beside) - wanted - missed), left = missed;
    int halvings = 0;
    for (; halvings < HALVINGS && !(fabs(left = at(&l, now + step) - wanted) < fabs(missed)); halvings++) step /= 2;
    if (halvings == HALVINGS) break;
    now += step;
    missed = left;
  }
  if (!(fabs(missed) <= fmax(1e-9 * fabs(wanted), 1e-12 * fabs(here)))) return LMOC_NOWHERE;
  moved[l.state] = now;
  return LMOC_MOVED;
}
