/* What happens at instants, with the rules and the numbers of `numerics/events/discrete_state.py`, `clock.py` and `event_handler.py`.
   With the values pre(v) fixed, all equations are solved for the values v, and again with pre(v) := v until nothing
   changes (Modelica specification 3.6, 8.6 and appendix B). */

#include "discrete.h"

#include <stdio.h>

static const double ROUNDING = 1e-14, MOMENT = 1e-9, SHORTLY = 1e-6, LEAST = 0x1p-500;
enum { START_ROUNDS = 50 };

/* ------------------------------------------------------------------ reinit */

static double aside(double value) { return value == 0 ? 1e-4 : value * (1 + 1e-4); }

/* The variable of a `reinit` as a function of one state. */
static double with(fmu *f, double *x, int64_t j, double value, int64_t i) {
  const double kept = x[j];
  x[j] = value;
  const int found = fmu_look(f, f->now.time, x);
  x[j] = kept;
  return found ? NAN : f->w[LOOK][f->model->events.reinit_register[i]];
}

/* The one state that a variable follows from, changed so that it has a value (`observe/one_state.py`). */
static int move_one(fmu *f, const double *from, int64_t i, double wanted, double *moved) {
  const int64_t n = f->model->states;
  double *x = f->moved + 2*n, *change = f->moved + 3*n, largest = 0;
  int64_t j = -1, followed = 0;
  memcpy(x, from, n * sizeof(double));
  const double here = n ? with(f, x, 0, x[0], i) : NAN;
  for (int64_t k = 0; k < n; k++) {
    change[k] = fabs(with(f, x, k, aside(x[k]), i) - here);
    if (change[k] * 0 == 0) largest = fmax(largest, change[k]);
  }
  for (int64_t k = 0; k < n; k++)
    if (!(change[k] <= 1e-9 * largest)) { followed++; j = k; }
  if (followed != 1 || !(here * 0 == 0)) return fmu_refused(f, "a variable of `reinit` does not follow from one state");
  double now = x[j], missed = here - wanted;
  for (int k = 0; k < 60; k++) {
    const double beside = aside(now);
    double step = -missed * (beside - now) / (with(f, x, j, beside, i) - wanted - missed), left = missed;
    int halvings = 0;
    for (; halvings < 40 && !(fabs(left = with(f, x, j, now + step, i) - wanted) < fabs(missed)); halvings++) step /= 2;
    if (halvings == 40) break;
    now += step;
    missed = left;
  }
  if (!(fabs(missed) <= fmax(1e-9 * fabs(wanted), 1e-12 * fabs(here))))
    return fmu_refused(f, "no value of a state gives a variable the value of its `reinit`");
  moved[j] = now;
  return FMU_GOOD;
}

/* The states with the values that `reinit` gives them; `some`: it gives any. */
static int reinit(fmu *f, const double *x, double *moved, int *some) {
  const fmu_events *e = &f->model->events;
  *some = 0;
  memcpy(moved, x, f->model->states * sizeof(double));
  for (int64_t i = 0; i < e->reinits; i++) {
    if (f->d[e->reinit_guard[i]] == 0) continue;
    const double value = f->w[ASSIGN][e->reinit_value[i]];
    *some = 1;
    if (e->reinit_state[i] >= 0) moved[e->reinit_state[i]] = value;
    else if (move_one(f, x, i, value, moved)) return FMU_WRONG;
  }
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ the clock */

static double tick(double start, double interval, double least) {
  if (!(interval > 0)) return INFINITY;
  double k = fmax(0, floor((least - start) / interval));
  while (start + k*interval <= least) k++;
  return start + k*interval;
}

/* The first time event behind a time; `include`: one at the time itself counts. */
static double next_time(fmu *f, double t, int include) {
  const fmu_events *e = &f->model->events;
  const double least = include ? t - near_to(t) : t + near_to(t), *w = f->w[PARAMETRIC];
  double found = INFINITY;
  for (int64_t i = 0; i < e->samples; i++)
    found = fmin(found, tick(w[e->sample_start[i]], w[e->sample_interval[i]], least));
  if (e->lines) fmu_run(f, LINES);
  for (int64_t r = 0; r < e->relations; r++) {
    if (e->row[r] >= 0) continue;
    const double slope = f->w[LINES][e->slope[-1 - e->row[r]]], offset = f->w[LINES][e->offset[-1 - e->row[r]]];
    double level = 0;
    if (e->op[r] == FLOOR) {
      const double exact = slope*least + offset;
      level = floor(exact) + (slope > 0);
      if (slope < 0 && level == exact) level--;
    }
    const double at = (level - offset) / slope;
    if (at * 0 == 0 && at > least && at < found) found = at;
  }
  return found;
}

static void ring(fmu *f, double t) {
  const fmu_events *e = &f->model->events;
  const double *w = f->w[PARAMETRIC];
  for (int64_t i = 0; i < e->samples; i++) {
    const double start = w[e->sample_start[i]], interval = w[e->sample_interval[i]],
                 k = nearbyint((t - start) / interval);
    f->d[e->sample[i]] = k >= 0 && fabs(start + k*interval - t) <= near_to(t);
  }
}

/* ------------------------------------------------------------------ roots */

int64_t fmu_roots(const fmu *f) {
  const fmu_events *e = &f->model->events;
  int64_t count = e->zeros + e->branches;
  for (int64_t k = 0; k < e->zeros; k++) count += fmu_rounded(e, k);
  return count;
}

int fmu_indicators(fmu *f, double time, const double *x, double *out) {
  const fmu_events *e = &f->model->events;
  int64_t upper = e->zeros;
  if (fmu_look(f, time, x)) return FMU_NO_VALUE;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double now = f->d[e->target[e->of_zero[k]]], value = fmu_value(f, k), margin = f->margin[k];
    if (fmu_rounded(e, k)) {
      out[k] = value - now + margin;
      out[upper++] = now + 1 - value + margin;
    } else out[k] = value + (now > 0 ? margin : -margin);
    if (out[k] == 0) out[k] = now > 0 || fmu_rounded(e, k) ? LEAST : -LEAST; /* solvers take what is zero for no indicator */
  }
  for (int64_t i = 0; i < e->branches; i++) out[upper + i] = f->w[LOOK][e->branch[i]];
  return FMU_GOOD;
}

void fmu_sides(const fmu *f, double *out) {
  const fmu_events *e = &f->model->events;
  const int64_t count = fmu_roots(f);
  for (int64_t k = 0; k < count; k++) out[k] = k < count - e->branches ? 1 : 0;
  for (int64_t k = 0; k < e->zeros; k++) if (!fmu_rounded(e, k) && !(f->d[e->target[e->of_zero[k]]] > 0)) out[k] = -1;
}

int fmu_asks(fmu *f, const double *values) {
  const int64_t count = fmu_roots(f);
  double *sides = f->root + count;
  fmu_sides(f, sides);
  for (int64_t k = 0; k < count; k++) if (values[k] * sides[k] < 0) return 1;
  return 0;
}

int fmu_passed(fmu *f) {
  return fmu_roots(f) && !fmu_indicators(f, f->now.time, f->x, f->root) && fmu_asks(f, f->root);
}

void fmu_seen(fmu *f) {
  for (int64_t k = 0; k < f->model->events.zeros; k++) {
    const double value = fmu_value(f, k);
    f->high[k] = fmax(f->high[k], fmu_height(&f->model->events, k, value));
    f->largest[k] = fmax(f->largest[k], fabs(value));
  }
}

void fmu_followed(fmu *f) {
  for (int64_t k = 0; k < f->model->events.zeros; k++) {
    if (f->high[k] > 100 * f->margin[k]) f->margin[k] = 0; /* it has left zero, whatever comes */
    f->high[k] = 0;
  }
}

/* ------------------------------------------------------------------ events */

/* Which zero functions are beyond their side, 1 (of rounded ones 2 at the upper edge), or will be so soon that it is the
   same instant. */
static int crossed(fmu *f, double *which) {
  const fmu_events *e = &f->model->events;
  const int64_t count = fmu_roots(f), n = f->model->states;
  const double t = f->now.time, ahead = 1e-14 * fmax(fabs(t), fabs(f->now.begin)) + 1e-12 * (t - f->now.begin);
  double *values = f->root, *sides = values + count, *later = sides + count, *x = f->moved;
  for (int64_t k = 0; k < e->zeros; k++) which[k] = 0;
  if (!count) return FMU_GOOD;
  if (fmu_indicators(f, t, f->x, values)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < n; i++) x[i] = f->x[i] + ahead * f->w[RIGHT][f->model->derivative[i]];
  if (!(t > f->now.last_instant) || fmu_indicators(f, t + ahead, x, later)) memcpy(later, values, count * sizeof(double));
  fmu_sides(f, sides);
  for (int64_t k = 0, upper = e->zeros; k < e->zeros; k++)
    for (int64_t edge = 0, at = k; edge < 1 + fmu_rounded(e, k); edge++, at = upper++) {
      const double now = values[at] * sides[at], then = later[at] * sides[at];
      if (now < 0 || (then < 0 && then < now)) which[k] = 1 + (double)edge;
    }
  return FMU_GOOD;
}

static int chatters(fmu *f, const double *which) {
  const double t = f->now.time, moment = MOMENT * fmax(f->model->span, near_to(t));
  for (int64_t k = 0; k < f->model->events.zeros; k++) {
    if (which[k] == 0) continue;
    double *times = f->times + k*FMU_CHATTER;
    memmove(times, times + 1, (FMU_CHATTER - 1) * sizeof(double));
    times[FMU_CHATTER - 1] = t;
    if (t - times[0] <= moment) {
      char text[400];
      snprintf(text, sizeof text, "%.300s switches back and forth: a friction with a stick mode ends that",
               f->model->events.texts[f->model->events.of_zero[k]]);
      return fmu_refused(f, text);
    }
  }
  return FMU_GOOD;
}

/* Let relations change whose functions are about to cross zero, though they are not there yet. */
static void turn_early(fmu *f, const double *which) {
  const fmu_events *e = &f->model->events;
  for (int64_t k = 0; k < e->zeros; k++) {
    double *now = f->d + e->target[e->of_zero[k]];
    if (which[k] == 0 || fmu_decided(f, k, *now) != *now) continue;
    *now = fmu_rounded(e, k) ? *now + (which[k] == 2 ? 1 : -1) : 1 - *now;
    f->margin[k] = fmax(f->margin[k], fmax(2 * fmu_height(e, k, f->zero[k]), ROUNDING * f->largest[k]));
  }
}

/* What the event's own conditions say of it. */
static int judge(fmu *f) {
  const fmu_events *e = &f->model->events;
  for (int64_t i = 0; i < e->checks; i++) {
    if (f->w[ASSIGN][e->check[i]] != 0) continue;
    (e->check_error[i] ? f->tell : f->warn)(f->owner, e->check_texts[i]);
    if (e->check_error[i]) return FMU_WRONG;
  }
  for (int64_t i = 0; i < e->ends; i++) {
    if (f->w[ASSIGN][e->end[i]] == 0 || f->now.ended) continue;
    f->now.ended = 1;
    f->warn(f->owner, e->end_texts[i]);
  }
  return FMU_GOOD;
}

/* Solve, remember and solve again, from what an instant has changed on. `turn_back` (zeros,): relations that change,
   instead of those that `which` tells of. */
static int event(fmu *f, int due, double instant, const double *which, const double *turn_back) {
  const fmu_events *e = &f->model->events;
  double *moved = f->moved;
  if (fmu_take(f, f->now.time, f->x)) return FMU_NO_VALUE;
  for (int round = 0; round < FMU_ROUNDS; round++) {
    int some = 0, changed = 0, found;
    fmu_remember(f);
    if (!round) {
      if (due) ring(f, instant);
      if (which) turn_early(f, which);
      for (int64_t k = 0; turn_back && k < e->zeros; k++) {
        double *own = f->d + e->target[e->of_zero[k]];
        if (turn_back[k] != 0) *own = 1 - *own;
      }
    }
    if ((found = fmu_settle(f, f->x)) || (found = judge(f)) || (found = reinit(f, f->x, moved, &some))) return found;
    for (int64_t i = 0; i < e->samples; i++) f->d[e->sample[i]] = 0;
    for (int64_t i = 0; i < e->before; i++)
      changed |= e->now[i] >= 0 && differ(f->d[e->now[i]], f->d[e->past[i]]);
    if (some) {
      memcpy(f->x, moved, f->model->states * sizeof(double));
      f->now.jumped = 1;
    }
    fmu_changed(f);
    if (!some && !changed) return FMU_GOOD;
    if (fmu_take(f, f->now.time, f->x)) return FMU_NO_VALUE;
  }
  return fmu_unsettled(f);
}

/* Until functions have left zero that they have just crossed, rounding does not bring them back. */
static void leave_zero(fmu *f, const double *which) {
  const fmu_events *e = &f->model->events;
  for (int64_t k = 0; k < e->zeros; k++) {
    if (fmu_height(e, k, f->zero[k]) > f->margin[k]) f->margin[k] = 0;
    if (which[k] == 0) continue;
    f->margin[k] = fmax(f->margin[k], ROUNDING * f->largest[k]);
    f->largest[k] = 0;
  }
}

/* Let conditions at zero change back where the jump of states sends them to the side they came from. */
static int come_back(fmu *f, const double *which) {
  const fmu_events *e = &f->model->events;
  const int64_t n = f->model->states;
  const double since = f->now.time - f->now.last_event, shortly = SHORTLY * since;
  double *x = f->moved, *back = f->back;
  int some = 0;
  f->now.last_event = f->now.time;
  if (!(since > 0) || fmu_take(f, f->now.time, f->x)) return FMU_GOOD;
  for (int64_t i = 0; i < n; i++) x[i] = f->x[i] + shortly * f->w[RIGHT][f->model->derivative[i]];
  if (fmu_look(f, f->now.time + shortly, x)) return FMU_GOOD;
  for (int64_t k = 0; k < e->zeros; k++) {
    const double ahead = fmu_value(f, k);
    back[k] = which[k] != 0 && !fmu_rounded(e, k) && fabs(f->zero[k]) < f->margin[k] && fabs(ahead) > f->margin[k] &&
              (ahead > 0) != (f->d[e->target[e->of_zero[k]]] > 0);
    some |= back[k] != 0;
  }
  return some ? event(f, 0, f->now.time, 0, back) : FMU_GOOD;
}

int fmu_happen(fmu *f) {
  const double t = f->now.time;
  const int due = t >= f->now.next - near_to(t);
  const double instant = due ? f->now.next : t;
  double *which = f->which;
  int some = 0, found;
  f->now.jumped = 0;
  if (f->now.ended || !f->model->events.discrete) return FMU_GOOD;
  if ((found = crossed(f, which)) || (found = chatters(f, which))) return found;
  if ((found = event(f, due, instant, which, 0))) return found;
  f->now.next = next_time(f, instant, 0);
  for (int64_t k = 0; k < f->model->events.zeros; k++) some |= which[k] != 0;
  if (some) leave_zero(f, which);
  if (some && f->now.jumped && (found = come_back(f, which))) return found;
  f->now.last_instant = t;
  if (fmu_look(f, t, f->x)) return FMU_NO_VALUE;
  lmoc_mark(&f->call);
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ the start, and assertions about the motion */

/* Discrete values that agree with each other and with the states. `for_good`: with the events of the start, else only to
   be looked at. */
int fmu_begin(fmu *f, int for_good) {
  const fmu_events *e = &f->model->events;
  const double t = f->now.time;
  int some = 0, found, changed = 1;
  f->now.settled = 1;
  f->now.jumped = 0;
  if (!e->discrete) return fmu_look(f, t, f->x);
  memcpy(f->d, e->start, e->discrete * sizeof(double));
  f->now.literal = 1;
  if (e->initial >= 0) f->d[e->initial] = 1;
  if (fmu_look(f, t, f->x)) return FMU_NO_VALUE;  /* which brings the parameters */
  fmu_remember(f);
  fmu_run(f, BEGIN);
  for (int64_t i = 0; i < e->begun; i++) f->d[e->begun_ones[i]] = f->w[BEGIN][e->registers[e->begun_ones[i]]];
  for (int round = 0; changed; round++) {
    double *before = fmu_in_history(f, FMU_BEGUN);
    if (round == START_ROUNDS) return fmu_unsettled(f);
    memcpy(before, f->d, e->discrete * sizeof(double));
    memset(f->margin, 0, e->zeros * sizeof(double));
    if (fmu_take(f, t, f->x)) return FMU_NO_VALUE;
    for (int64_t i = 0; i < e->before; i++) if (e->now[i] < 0) f->d[e->past[i]] = f->w[LOOK][e->source[i]];
    fmu_assign(f);
    changed = 0;
    for (int64_t i = 0; i < e->discrete; i++) changed |= differ(before[i], f->d[i]);
  }
  if (for_good) {
    if ((found = reinit(f, f->x, f->moved, &some))) return found;
    if (some) memcpy(f->x, f->moved, f->model->states * sizeof(double));
  }
  if (e->initial >= 0) f->d[e->initial] = 0;
  fmu_remember(f);
  if ((found = fmu_settle(f, f->x))) return found;
  fmu_remember(f);
  f->now.literal = 0;
  fmu_changed(f);
  if (!for_good) return FMU_GOOD;
  f->now.begun = 1;
  f->now.last_event = f->now.last_instant = t;
  f->now.next = next_time(f, t, 1);
  return f->now.next <= t + near_to(t) ? fmu_happen(f) : FMU_GOOD;
}

int fmu_holds(fmu *f) {
  const fmu_events *e = &f->model->events;
  if (!e->watched) return FMU_GOOD;
  if (fmu_look(f, f->now.time, f->x)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < e->watched; i++) {
    int known = 1;
    for (int64_t j = e->first_known[i]; j < e->first_known[i + 1]; j++) known &= f->w[LOOK][e->known[j]] * 0 == 0;
    if (!known || f->w[LOOK][e->held[i]] != 0) continue;
    if (e->held_error[i]) return fmu_refused(f, e->held_texts[i]);
    if (f->warned[i] == 0) f->warn(f->owner, e->held_texts[i]);
    f->warned[i] = 1;
  }
  return FMU_GOOD;
}
