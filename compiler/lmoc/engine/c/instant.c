/* The iteration of an event (`instant.h`), and when time events come. */

#include "instant.h"

static double *in_history(const lmoc_instant *e, int64_t k) { return e->history + k*e->discrete; }

static void keep(const lmoc_instant *e, int64_t k) {
  double *to = in_history(e, k);
  for (int64_t i = 0; i < e->discrete; i++) to[i] = e->v[e->own[i]];
}

/* ------------------------------------------------------------------ solving */

int lmoc_take(lmoc_instant *e, double time, const double *x) {
  int found;
  e->time = time;
  if ((found = e->look(e, time, x))) return found;
  return e->zeros ? e->widen(e, time, x) : LMOC_SETTLED;
}

/* Run a program at a place with the present discrete values. */
static void run_at(const lmoc_instant *e, const lmoc_looking *s, double time, const double *x) {
  const lmoc_view *own = e->owner;
  int changed = 0;
  for (int64_t i = 0; i < e->discrete; i++) {
    double *to = s->w + own->given[i];
    changed |= lmoc_differ(*to, e->v[e->own[i]]);
    *to = e->v[e->own[i]];
  }
  for (int64_t i = 0; changed && i < s->blocks; i++) {
    s->block[i].ready = 0;
    if (s->block[i].lu) lmoc_lu_forget(s->block[i].lu);
  }
  for (int64_t i = 0; i < e->states; i++) s->w[own->states[i]] = x[i];
  lmoc_tape_run(time, s->w, s->tape);
}

int lmoc_look_at(lmoc_instant *e, double time, const double *x) {
  const lmoc_view *s = e->owner;
  run_at(e, &s->at, time, x);
  for (int64_t k = 0; k < e->zeros; k++) e->zero[k] = s->at.w[s->zero[k]];
  for (int64_t i = 0; i < s->seen; i++) e->v[s->to[i]] = s->at.w[s->from[i]];
  return LMOC_SETTLED;
}

int lmoc_look_along(lmoc_instant *e, double time, const double *x, double *rates, double *zeros) {
  const lmoc_view *s = e->owner;
  run_at(e, &s->along, time, x);
  for (int64_t i = 0; i < e->states; i++) rates[i] = s->along.w[s->rates[i]];
  for (int64_t k = 0; k < e->zeros; k++) zeros[k] = s->along.w[s->zero[k]];
  return LMOC_SETTLED;
}

void lmoc_remember(lmoc_instant *e) {
  for (int64_t i = 0; i < e->before; i++) e->v[e->past[i]] = e->v[e->now[i]];
}

static void lines(lmoc_instant *e) {
  if (!e->lines) return;
  for (int64_t i = 0; i < e->discrete; i++) e->line[e->own[i]] = e->v[e->own[i]];
  lmoc_tape_run(e->time, e->line, e->lines);
}

void lmoc_assign(lmoc_instant *e) {
  lines(e);
  lmoc_relations(e);
  lmoc_tape_run(e->time, e->v, e->assign);
}

int64_t lmoc_turn(lmoc_instant *e, const double *x) {
  const double *before = in_history(e, LMOC_BEFORE);
  int64_t changed = 0;
  if (lmoc_take(e, e->time, x)) return -1;
  keep(e, LMOC_BEFORE);
  lmoc_assign(e);
  for (int64_t i = 0; i < e->discrete; i++) {
    e->changed[i] = lmoc_differ(before[i], e->v[e->own[i]]);
    changed += e->changed[i] != 0;
  }
  return changed;
}

/* What a hook has found, with what follows from it. */
static int answer(lmoc_instant *e, int (*hook)(lmoc_instant *, double, const double *), const double *x) {
  const int found = hook(e, e->time, x);
  if (!found) lmoc_tape_run(e->time, e->v, e->assign);
  return found;
}

int lmoc_solve_instant(lmoc_instant *e, const double *x) {
  const size_t size = (size_t)e->discrete * sizeof(double);
  keep(e, LMOC_BEGUN);
  memset(e->flipped, 0, size);
  for (int64_t seen = 0, repeated = 0; seen < LMOC_ROUNDS && !repeated; seen++) {
    const int64_t changed = lmoc_turn(e, x);
    if (changed < 0) return LMOC_NO_VALUE;
    if (!changed) return e->regular ? answer(e, e->regular, x) : LMOC_SETTLED;
    for (int64_t i = 0; i < e->discrete; i++) if (e->changed[i] != 0) e->flipped[i] = 1;
    keep(e, seen);
    for (int64_t k = 0; k < seen && !repeated; k++) repeated = !memcmp(in_history(e, k), in_history(e, seen), size);
  }
  return answer(e, e->others, x);
}

/* ------------------------------------------------------------------ events */

int lmoc_reinit(lmoc_instant *e, const double *x, int *some) {
  *some = 0;
  for (int64_t i = 0; i < e->reinits; i++) {
    if (e->v[e->guard[i]] == 0) continue;
    const double value = e->v[e->value[i]];
    if (!*some) memcpy(e->moved, x, (size_t)e->states * sizeof(double));
    *some = 1;
    if (e->state[i] >= 0) e->moved[e->state[i]] = value;
    else if (e->move(e, x, i, value, e->moved)) return LMOC_HALTED;
  }
  return *some && e->follow && e->follow(e, x, e->moved) ? LMOC_HALTED : LMOC_SETTLED;
}

/* Note the conditions of which something is to be told, each once. */
static void note(lmoc_instant *e) {
  for (int64_t i = 0; i < e->told; i++) {
    int64_t k = 0;
    if ((e->v[e->tell[i]] != 0) != e->sought[i]) continue;
    while (k < e->found_count && e->found[k] != i) k++;
    if (k == e->found_count) e->found[e->found_count++] = i;
  }
}

/* Where no values agree: those that the values before lead to, once, are the next ones to begin with. A friction that
   starts to slide against less than what has held it, and so stays stuck: it slides once it has begun to. */
static int go_on(lmoc_instant *e, const double *x) {
  const double *begun = in_history(e, LMOC_BEGUN);
  for (int64_t i = 0; i < e->discrete; i++) e->v[e->own[i]] = begun[i];
  return lmoc_turn(e, x) < 0 ? LMOC_NO_VALUE : LMOC_SETTLED;
}

static int event(lmoc_instant *e, double *x) {
  int agreed = 1;
  for (int round = 0; round < LMOC_ROUNDS; round++) {
    int some = 0, changed = 0, found;
    if (round) lmoc_remember(e);
    found = lmoc_solve_instant(e, x);
    if (found == LMOC_UNSETTLED && agreed) {
      agreed = 0;
      if ((found = go_on(e, x))) return found;
      continue;
    }
    if (found) return found;
    agreed = 1;
    note(e);
    if ((found = lmoc_reinit(e, x, &some))) return found;
    for (int64_t i = 0; i < e->samples; i++) e->v[e->sample[i]] = 0;
    for (int64_t i = 0; i < e->before; i++)
      changed |= e->held[i] && lmoc_differ(e->v[e->now[i]], e->v[e->past[i]]);
    if (some) memcpy(x, e->moved, (size_t)e->states * sizeof(double));
    e->jumped |= some;
    if (!some && !changed) return LMOC_SETTLED;
    if ((found = lmoc_take(e, e->time, x))) return found;
  }
  return LMOC_UNSETTLED;
}

int lmoc_event(lmoc_instant *e, double *x) {
  e->found_count = e->jumped = 0;
  const int found = event(e, x);
  for (int64_t k = 0; k < e->zeros; k++) e->crossed[k] = 0;
  return found;
}

/* ------------------------------------------------------------------ the clock */

/* The first of start + k·interval behind a time. */
static double tick(double start, double interval, double least) {
  if (!(interval > 0)) return INFINITY;
  double k = fmax(0, floor((least - start) / interval));
  while (start + k*interval <= least) k++;
  return start + k*interval;
}

double lmoc_next_time(lmoc_instant *e, double time, int include) {
  const double least = include ? time - lmoc_near_to(time) : time + lmoc_near_to(time);
  double found = INFINITY;
  for (int64_t i = 0; i < e->samples; i++) found = fmin(found, tick(e->v[e->start[i]], e->v[e->interval[i]], least));
  lines(e);
  for (int64_t r = 0; r < e->relations; r++) {
    if (e->row[r] >= 0) continue;
    const double slope = e->line[e->slope[-1 - e->row[r]]], offset = e->line[e->offset[-1 - e->row[r]]];
    double level = 0;
    if (e->op[r] == LMOC_FLOOR) {
      const double exact = slope*least + offset;
      level = floor(exact) + (slope > 0);
      if (slope < 0 && level == exact) level--;
    }
    const double at = (level - offset) / slope;
    if (at * 0 == 0 && at > least && at < found) found = at;
  }
  return found;
}

void lmoc_ring(lmoc_instant *e, double time) {
  for (int64_t i = 0; i < e->samples; i++) {
    const double start = e->v[e->start[i]], interval = e->v[e->interval[i]], k = nearbyint((time - start) / interval);
    e->v[e->sample[i]] = k >= 0 && fabs(start + k*interval - time) <= lmoc_near_to(time);
  }
}
