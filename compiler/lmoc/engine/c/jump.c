/* Impulses from derivatives of steps (`jump.h`). */

#include "jump.h"

#include <stdlib.h>
#include <string.h>

static const double CONTINUOUS = 1e-9; /* share of a value by which it may change at an event and still be continuous */
static const double BENT = 1e-2;       /* of what a value changes by from one place nearby to the next */
static const double LARGE = 1e6;       /* impulses per rate, so that the rates themselves are no more than their rounding */
static const double LINEAR = 1e-6;     /* relative deviation of rates from being linear in an impulse */
static const double AGREE = 1e-11;     /* relative difference of two ways, of which the second has twice as many steps */
static const double EPSILON = 0x1p-52;
enum { FEW = 8, MANY = 1024 };         /* steps on the way, where what an impulse does depends on the place */

const char *lmoc_jump_reason(int status) {
  static const char *const reasons[] = {
    [LMOC_JUMPED] = "",
    [LMOC_JUMP_NO_VALUE] = "the equations have no solution on its way",
    [LMOC_JUMP_SECOND] = "the motion needs its second derivative, which is more than an impulse there (give a ramp of finite "
                         "length instead of a step)",
    [LMOC_JUMP_POWER] = "what follows from it is not proportional to its velocity (give a ramp of finite length)",
    [LMOC_JUMP_ENDLESS] = "its effect cannot be determined: give a ramp of finite length",
    [LMOC_JUMP_NO_MEMORY] = "there is no memory",
  };
  return reasons[status];
}

int lmoc_steps_between(int64_t count, const double *values, double *sides, double *change) {
  const double *near = values, *far = near + count, *after = far + count, *beyond = after + count;
  int some = 0;
  for (int64_t k = 0; k < count; k++) {
    const double old = 2*near[k] - far[k], new = 2*after[k] - beyond[k];
    const double bends = BENT * (fabs(near[k] - far[k]) + fabs(after[k] - beyond[k]));
    const int small = fabs(new - old) <= CONTINUOUS * fmax(fabs(old), fabs(new)) + bends;
    sides[k] = old;
    sides[count + k] = new;
    change[k] = small ? 0 : new - old;
    some |= !small;
  }
  return some;
}

/* One step on its way. */
typedef struct {
  const lmoc_jump *j;
  const double *old, *change;
  int32_t *which;
  double *given, *impulse, *twice;  /* (given,) what is given; impulses of derivatives, and derivatives of impulses */
  double *still, *one, *two;        /* (states + judged,) */
  int some;                         /* whether there are derivatives of impulses */
} push;

static int begin(push *p, const lmoc_jump *j, const double *old, const double *change, int64_t more) {
  const int64_t n = j->given, m = j->states + j->judged;
  double *memory = calloc((size_t)(3*n + 3*m + more + (n + 1) / 2 + 1), sizeof(double));
  if (!memory) return LMOC_JUMP_NO_MEMORY;
  *p = (push){j, old, change, (int32_t *)(memory + 3*n + 3*m + more), memory, memory + n, memory + 2*n,
              memory + 3*n, memory + 3*n + m, memory + 3*n + 2*m, 0};
  for (int64_t i = 0; i < j->rows; i++) {
    const int32_t lower = j->lower[i], origin = j->origin[i];
    if (lower >= 0 && change[lower] != 0) p->impulse[j->upper[i]] = change[lower];
    if (!j->second[i] || change[origin] == 0) continue;
    p->twice[j->upper[i]] = change[origin];
    p->some = 1;
  }
  return LMOC_JUMPED;
}

/* Values at a place on the way, with so many impulses. */
static int at(push *p, const double *x, double s, const double *impulses, double times, double *out) {
  const lmoc_jump *j = p->j;
  for (int64_t k = 0; k < j->given; k++) {
    const int steps = p->change[k] != 0;
    p->which[k] = steps || impulses[k] != 0;
    p->given[k] = (steps ? p->old[k] + s * p->change[k] : 0) + times * impulses[k];
  }
  return j->values(j->owner, x, p->which, p->given, out) ? LMOC_JUMP_NO_VALUE : LMOC_JUMPED;
}

static int all_three(push *p, const double *x, double s) {
  int found = at(p, x, s, p->impulse, 0, p->still);
  if (!found) found = at(p, x, s, p->impulse, LARGE, p->one);
  return found ? found : at(p, x, s, p->impulse, 2*LARGE, p->two);
}

/* How fast the states change on their way, s from 0 to 1. */
static int effect(push *p, const double *x, double s, double *out) {
  const lmoc_jump *j = p->j;
  double size = 0, rates = 0;
  const int found = all_three(p, x, s);
  if (found) return found;
  for (int64_t i = 0; i < j->states; i++) {
    p->one[i] = j->ledger[i] ? 0 : (p->one[i] - p->still[i]) / LARGE;
    p->two[i] = j->ledger[i] ? 0 : (p->two[i] - p->still[i]) / LARGE;
    if (!(p->one[i] * 0 == 0)) return LMOC_JUMP_POWER;
    size = fmax(size, fabs(p->one[i]));
    rates = fmax(rates, fabs(p->still[i]));
  }
  const double rounding = EPSILON * (size + rates / LARGE);
  for (int64_t i = 0; i < j->states; i++) {
    if (!(fabs(p->two[i] - 2*p->one[i]) <= LINEAR * size)) return LMOC_JUMP_POWER;
    out[i] = fabs(p->one[i]) <= 10 * rounding ? 0 : p->one[i];
  }
  return LMOC_JUMPED;
}

/* Whether anything but derivatives depends on the derivative of an impulse, such as a force. */
static int needs_second(push *p, const double *x) {
  const lmoc_jump *j = p->j;
  int found = LMOC_JUMPED;
  for (int k = 0; k < 2 && !found; k++) {
    for (int64_t i = 0; i < j->given; i++) {
      p->which[i] = p->change[i] != 0 || p->twice[i] != 0;
      p->given[i] = p->twice[i] != 0 ? k * LARGE * p->twice[i] : p->old[i];
    }
    if (j->values(j->owner, x, p->which, p->given, k ? p->one : p->still)) return LMOC_JUMP_NO_VALUE;
  }
  for (int64_t i = 0; i < j->states + j->judged; i++)
    if (fabs(p->one[i] - p->still[i]) > LINEAR * (1 + fabs(p->still[i]))) found = LMOC_JUMP_SECOND;
  return found;
}

static double largest(int64_t count, const double *values, const double *others) {
  double found = 0;
  for (int64_t i = 0; i < count; i++) found = fmax(found, fabs(values[i] - (others ? others[i] : 0)));
  return found;
}

/* One step of the classical Runge-Kutta method, from `s` on. */
static int step(push *p, double s, double h, double *x, double *place, double *sum, double *slope) {
  static const double nodes[] = {0, 0.5, 0.5, 1}, weights[] = {1, 2, 2, 1};
  const int64_t n = p->j->states;
  memset(sum, 0, (size_t)n * sizeof(double));
  for (int k = 0; k < 4; k++) {
    for (int64_t i = 0; i < n; i++) place[i] = x[i] + (k ? h * nodes[k] * slope[i] : 0);
    const int found = effect(p, place, s + nodes[k] * h, slope);
    if (found) return found;
    for (int64_t i = 0; i < n; i++) sum[i] += weights[k] * slope[i];
  }
  for (int64_t i = 0; i < n; i++) x[i] += h / 6 * sum[i];
  return LMOC_JUMPED;
}

/* The change of the states from s = 0 to 1, in `moved`; `work` (5, states). */
static int way(push *p, const double *x, double *moved, double *work) {
  const int64_t n = p->j->states;
  double *end = work, *place = end + n, *sum = place + n, *slope = sum + n, *before = slope + n;
  int found = effect(p, x, 0, moved);
  for (int64_t i = 0; i < n; i++) end[i] = x[i] + moved[i];
  if (!found) found = effect(p, end, 1, slope);
  if (found || largest(n, slope, moved) <= AGREE * largest(n, moved, 0)) return found;
  for (int64_t steps = FEW; steps <= MANY; steps *= 2) {
    memcpy(before, moved, (size_t)n * sizeof(double));
    memcpy(end, x, (size_t)n * sizeof(double));
    for (int64_t k = 0; k < steps; k++)
      if ((found = step(p, (double)k / (double)steps, 1 / (double)steps, end, place, sum, slope))) return found;
    for (int64_t i = 0; i < n; i++) moved[i] = end[i] - x[i];
    if (largest(n, moved, before) <= AGREE * largest(n, moved, 0)) return LMOC_JUMPED;
  }
  return LMOC_JUMP_ENDLESS;
}

int lmoc_jump_states(const lmoc_jump *j, const double *old, const double *change, const double *x, double *moved) {
  push p;
  int found = begin(&p, j, old, change, 5 * j->states);
  if (found) return found;
  if (p.some) found = needs_second(&p, x);
  if (!found) found = way(&p, x, moved, p.two + j->states + j->judged);
  free(p.given);
  return found;
}

int lmoc_jump_work(const lmoc_jump *j, const double *old, const double *change, const double *x) {
  push p;
  int found = begin(&p, j, old, change, 0);
  if (found) return found;
  found = all_three(&p, x, 0);
  for (int64_t i = 0; i < j->states && !found; i++)
    if (j->ledger[i] && fabs(p.two[i] - 2*p.one[i] + p.still[i]) > LINEAR * fabs(p.one[i] - p.still[i]))
      found = LMOC_JUMP_ENDLESS;
  free(p.given);
  return found;
}
