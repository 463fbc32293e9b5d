/* Values of relations that are tried at an event, where solving in turn leads to none, or to a singular block. */

#include "instant.h"

#include <stdlib.h>

static const double NOISES = 4;    /* times the bound for its rounding, within which a function is zero ... */
static const double EQUAL = 1e-13; /* ... or this share of the largest one where no bounds are known */
enum {
  TRIALS = 1024,                   /* combinations of values that are tried: all those of ten relations */
  FEW = 3,                         /* relations that are changed at once among all */
  SETTLING = 20,                   /* rounds in which the values behind a combination agree, or do not */
  MOST_AT_ONCE = 64
};

/* Whether relations have the values that are being tried, behind all that follows from these. Where both sides are equal,
   either will do: a friction that holds no more than its limit slides and does not move, two of them on one shaft at
   rest. It stays as it has been taken, also where it is exactly zero; but one whose crossing is the event does not come
   back to where it would cross again. */
static int agrees(lmoc_instant *e, const double *x, int64_t count, const int64_t *zeros) {
  int64_t changed = 1;
  double largest = 1;
  for (int k = 0; k < SETTLING && changed > 0; k++) changed = lmoc_turn(e, x);
  if (changed) return 0;
  for (int64_t k = 0; k < e->zeros; k++) largest = fmax(largest, fabs(e->zero[k]));
  for (int widen = 0; widen < 2; widen++)
    for (int64_t i = 0; i < count; i++) {
      const int64_t k = zeros[i], r = e->of_zero[k];
      if ((lmoc_decide(e->op[r], e->zero[k]) != 0) == (e->v[e->target[r]] > 0)) continue;
      if (e->crossed[k] != 0 && lmoc_differ(e->crossed[k] - 1, e->v[e->target[r]])) return 0;
      if (e->bounds && !widen && lmoc_rounding(e, e->time, x)) return 0;
      const double allowed = fmax(e->margin[k], e->bounds ? NOISES * e->bound[k] : EQUAL * largest);
      if (!(fabs(e->zero[k]) <= allowed)) return 0;
      if (widen) e->margin[k] = allowed;
    }
  return 1;
}

/* The next choice of some of `count`; 0 where there is none. */
static int next_choice(int64_t size, int64_t count, int64_t *chosen) {
  int64_t last = size - 1;
  while (last >= 0 && chosen[last] == count - size + last) last--;
  if (last < 0) return 0;
  chosen[last]++;
  for (int64_t i = last + 1; i < size; i++) chosen[i] = chosen[i - 1] + 1;
  return 1;
}

int lmoc_try(lmoc_instant *e, const double *x, const double *begun, int64_t count, const int64_t *zeros, int64_t most,
             int64_t trials, int (*accept)(lmoc_instant *e, double time, const double *x)) {
  int64_t chosen[MOST_AT_ONCE];
  int found = 0;
  memset(e->supposed, 0, (size_t)e->relations * sizeof(double));
  for (int64_t i = 0; i < count; i++) e->supposed[e->of_zero[zeros[i]]] = 1;
  e->supposing = 1;
  for (int64_t size = 0; size <= most && size <= count && size <= MOST_AT_ONCE && !found; size++) {
    int more = 1;
    for (int64_t i = 0; i < size; i++) chosen[i] = i;
    for (; more && trials > 0 && !found; trials--) {
      for (int64_t i = 0; i < e->discrete; i++) e->v[e->own[i]] = begun[i];
      for (int64_t i = 0; i < size; i++) {
        double *own = e->v + e->target[e->of_zero[zeros[chosen[i]]]];
        *own = 1 - *own;
      }
      found = agrees(e, x, count, zeros) && (!accept || !accept(e, e->time, x));
      more = next_choice(size, count, chosen);
    }
  }
  e->supposing = 0;
  return found ? LMOC_SETTLED : LMOC_UNSETTLED;
}

/* ------------------------------------------------------------------ which relations */

/* One more than the last place of what is assigned, and of what its equations read. */
static int64_t places(const lmoc_instant *e) {
  int64_t found = 0;
  for (int64_t i = 0; i < e->discrete; i++) if (e->own[i] >= found) found = e->own[i] + 1;
  for (int64_t i = 0; i < e->assigned; i++) {
    if (e->filled[i] >= found) found = e->filled[i] + 1;
    for (int64_t j = e->first_used[i]; j < e->first_used[i + 1]; j++) if (e->used[j] >= found) found = e->used[j] + 1;
  }
  return found;
}

/* Functions of relations in a mask of places; those that are rounded are none to be tried. */
static int64_t decide_about(const lmoc_instant *e, const uint8_t *mask, int64_t *zeros) {
  int64_t count = 0;
  for (int64_t k = 0; k < e->zeros; k++) if (!lmoc_rounded(e, k) && mask[e->target[e->of_zero[k]]]) zeros[count++] = k;
  return count;
}

static void mark(const lmoc_instant *e, const double *changed, uint8_t *mask) {
  for (int64_t i = 0; i < e->discrete; i++) mask[e->own[i]] = changed[i] != 0;
}

int64_t lmoc_zeros_read(const lmoc_instant *e, const double *changed, int64_t *zeros) {
  const int64_t size = places(e);
  uint8_t *mask = calloc((size_t)(2*size) + 1, 1), *read = mask + size;
  int64_t count = -1;
  if (!mask) return count;
  mark(e, changed, mask);
  for (int64_t i = 0; i < e->assigned; i++)
    for (int64_t j = e->first_used[i]; mask[e->filled[i]] && j < e->first_used[i + 1]; j++) read[e->used[j]] = 1;
  count = decide_about(e, read, zeros);
  free(mask);
  return count;
}

int lmoc_try_relations(lmoc_instant *e, double time, const double *x) {
  const int64_t size = places(e);
  const double *begun = e->history + LMOC_BEGUN*e->discrete;
  uint8_t *mask = calloc((size_t)size + 1, 1);
  int64_t *zeros = malloc((size_t)(e->zeros + 1) * sizeof(int64_t)), count;
  double *changed = malloc((size_t)(e->discrete + 1) * sizeof(double)); /* in the last turn: that is told of */
  int found = LMOC_HALTED;
  (void)time;
  if (mask && zeros && changed) {
    memcpy(changed, e->changed, (size_t)e->discrete * sizeof(double));
    mark(e, e->flipped, mask);
    count = decide_about(e, mask, zeros);
    found = lmoc_try(e, x, begun, count, zeros, count, TRIALS, 0);
    if (found && (count = lmoc_zeros_read(e, e->flipped, zeros)) >= 0)
      found = lmoc_try(e, x, begun, count, zeros, FEW, TRIALS, 0);
    memcpy(e->changed, changed, (size_t)e->discrete * sizeof(double));
  }
  free(mask);
  free(zeros);
  free(changed);
  return found;
}
