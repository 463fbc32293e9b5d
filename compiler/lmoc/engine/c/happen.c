/* From event to event (`happen.h`). */

#include "happen.h"

enum { START_ROUNDS = 50 };  /* of finding states and discrete values at the start that agree */

static void hold(lmoc_events *v) {
  const lmoc_instant *e = v->e;
  for (int64_t i = 0; i < e->discrete; i++) v->held[i] = e->v[e->own[i]];
}

/* ------------------------------------------------------------------ one event */

/* Whether functions cross zero again at the instant of their last crossing. */
static int again(const lmoc_events *v, double time) {
  int some = 0;
  for (int64_t k = 0; k < v->e->zeros && v->fold; k++) {
    const double last = v->h->times[k*LMOC_CHATTER + LMOC_CHATTER - 2];
    v->folds[k] = v->which[k] != 0 && time - last <= lmoc_located(time, v->h->begin);
    some |= v->folds[k] != 0;
  }
  return some;
}

static int cross_over(lmoc_events *v, double time, double *x) {
  const int found = again(v, time) ? v->fold(v, time, x) : LMOC_UNSETTLED;
  if (found != LMOC_UNSETTLED) return found;
  lmoc_turn_early(v->e, v->which);
  return LMOC_SETTLED;
}

static void turn_back(lmoc_events *v) {
  const lmoc_instant *e = v->e;
  for (int64_t k = 0; k < e->zeros; k++) {
    double *own = e->v + e->target[e->of_zero[k]];
    if (v->turn[k] != 0) *own = 1 - *own;
  }
}

enum { NOTHING, CROSSED, BACK, ENDS };  /* what changes beside samples that are due */

/* Whether an event has changed what the equations of the motion read. */
static int turns(const lmoc_events *v) {
  const lmoc_instant *e = v->e;
  for (int64_t i = 0; i < e->discrete; i++) {
    if (!lmoc_differ(v->held[i], e->v[e->own[i]])) continue;
    for (int64_t k = 0; k < e->bounded; k++) if (e->read[k] == e->own[i]) return 1;
  }
  return 0;
}

static int told(lmoc_events *v, double time, double *x) {
  const int found = v->happened(v, time, x);
  if (v->jumped || turns(v)) *v->turned = time;
  return found;
}

/* An event where the continuous values have been looked at. */
static int event(lmoc_events *v, double time, double *x, int change) {
  lmoc_instant *e = v->e;
  const int due = time >= *v->next - lmoc_near_to(time); /* also where something else has ended the segment then */
  const double instant = due ? *v->next : time;
  int found;
  v->kind = change == ENDS ? LMOC_TERMINAL : due ? LMOC_TIME : LMOC_WHEN;
  memcpy(v->begun, x, (size_t)e->states * sizeof(double));
  hold(v);
  lmoc_remember(e);
  if (due) lmoc_ring(e, instant);
  if (change == ENDS) e->v[v->terminal] = 1;
  if (change == CROSSED && (found = cross_over(v, time, x))) return found;
  if (change == BACK) turn_back(v);
  if ((found = lmoc_event(e, x))) return found;
  v->jumped = e->jumped;
  *v->next = lmoc_next_time(e, instant, 0);
  return told(v, time, x);
}

static int look_and_happen(lmoc_events *v, double time, double *x, int change) {
  const int found = lmoc_take(v->e, time, x);
  return found ? found : event(v, time, x, change);
}

/* ------------------------------------------------------------------ what ends a segment */

static int too_low(lmoc_events *v, int found) {
  for (v->culprit = 0; v->culprit + 1 < v->e->zeros && v->turn[v->culprit] == 0;) v->culprit++;
  return found;
}

/* Functions cross zero, as long as the run gets on; conditions change back where a jump of states sends them to the side
   they came from. */
static int cross(lmoc_events *v, double time, double *x) {
  lmoc_instant *e = v->e;
  int some = 0, found;
  v->culprit = lmoc_cross(e, v->h, time, v->which);
  if (v->culprit >= 0) return LMOC_TOO_OFTEN;
  if ((found = lmoc_wrong_way(e, v->h, time, x, v->which, v->turn))) return too_low(v, found);
  if ((found = lmoc_take(e, time, x))) return found;
  memcpy(v->at, e->zero, (size_t)e->zeros * sizeof(double));
  if ((found = event(v, time, x, CROSSED))) return found;
  lmoc_leave_zero(e, v->which);
  if (!v->jumped) return LMOC_SETTLED;
  if ((found = lmoc_turned_back(e, v->h, time, v->begun, x, v->which, v->at, v->turn))) return too_low(v, found);
  for (int64_t k = 0; k < e->zeros; k++) some |= v->turn[k] != 0;
  return some ? look_and_happen(v, time, x, BACK) : LMOC_SETTLED;
}

int lmoc_events_after(lmoc_events *v, double time, double *x, int crossed) {
  const double end = v->h->begin + v->h->span;
  int some = crossed, found;
  if (crossed && (found = lmoc_without_noise(v, time, x, &some))) return found;
  if (some) return cross(v, time, x);
  if (time >= *v->next - lmoc_near_to(time)) return look_and_happen(v, time, x, NOTHING);
  if (crossed && (v->terminal < 0 || time < end - lmoc_near_to(time))) return LMOC_SETTLED;
  if (v->terminal >= 0 && v->e->v[v->terminal] == 0) return look_and_happen(v, time, x, ENDS);
  return LMOC_OVER;
}

int lmoc_events_settle(lmoc_events *v, double time, double *x) {
  *v->turned = time;
  return look_and_happen(v, time, x, NOTHING);
}

/* ------------------------------------------------------------------ the start */

static void flag(const lmoc_events *v, double value) {
  if (v->initial >= 0) v->e->v[v->initial] = value;
}

/* States and discrete values that agree. What is not discrete has been what it is; what is exactly zero is that, since
   nothing has crossed zero yet. */
static int agree(lmoc_events *v, double time, double *x) {
  lmoc_instant *e = v->e;
  int found;
  for (int round = 0; round < START_ROUNDS; round++) {
    int64_t changed = 0;
    hold(v);
    if (v->states && (found = v->states(v, x))) return found;
    memset(e->margin, 0, (size_t)e->zeros * sizeof(double));
    if ((found = lmoc_take(e, time, x))) return found;
    for (int64_t i = 0; i < e->before; i++) if (!e->held[i]) e->v[e->past[i]] = e->v[e->now[i]];
    if ((found = v->equations(v, 0))) return found;
    lmoc_assign(e);
    for (int64_t i = 0; i < e->discrete; i++) {
      e->changed[i] = lmoc_differ(v->held[i], e->v[e->own[i]]);
      changed += e->changed[i] != 0;
    }
    if (!changed) return LMOC_SETTLED;
  }
  return LMOC_UNSETTLED;
}

static int start(lmoc_events *v, double time, double *x, int tried) {
  lmoc_instant *e = v->e;
  int some = 0, found;
  flag(v, 1);
  if ((found = v->equations(v, 1)) || (found = agree(v, time, x))) return found;
  if (!tried && (found = lmoc_reinit(e, x, &some))) return found;
  if (some) memcpy(x, e->moved, (size_t)e->states * sizeof(double));
  flag(v, 0);
  lmoc_remember(e);
  if (tried) return lmoc_solve_instant(e, x);
  if ((found = lmoc_take(e, time, x))) return found;
  lmoc_remember(e);
  if ((found = lmoc_event(e, x))) return found;
  v->kind = LMOC_START;
  v->jumped = some || e->jumped;
  hold(v);
  return told(v, time, x);
}

int lmoc_events_start(lmoc_events *v, double time, double *x, int tried) {
  lmoc_instant *e = v->e;
  e->literal = 1;
  const int found = start(v, time, x, tried);
  if (found) return found;
  e->literal = 0;
  lmoc_remember(e);
  if (tried) return LMOC_SETTLED;
  *v->next = lmoc_next_time(e, time, 1);
  return *v->next <= time + lmoc_near_to(time) ? lmoc_events_settle(v, time, x) : LMOC_SETTLED;
}
