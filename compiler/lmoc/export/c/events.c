/* What happens to an FMU at instants, with the rules of `numerics/events/event_handler.py`; the iteration of an event is
   that of `engine/c/instant.c`. */

#include "discrete.h"
#include "fmu_laws.h"
#include "fmu_loops.h"

#include <stdio.h>

static const double LEAST = 0x1p-500;

/* ------------------------------------------------------------------ reinit */

/* The variable of a `reinit` for some states. */
static double seen(lmoc_instant *e, const double *x, int64_t i) {
  fmu *f = e->owner;
  return fmu_look(f, e->time, x) ? NAN : f->w[LOOK][f->model->events.reinit_register[i]];
}

int fmu_move(lmoc_instant *e, const double *x, int64_t i, double wanted, double *moved) {
  fmu *f = e->owner;
  switch (lmoc_move_one(e, seen, x, i, wanted, moved, f->moved + 2*e->states)) {
    case LMOC_MOVED: return FMU_GOOD;
    case LMOC_NOT_ONE: return fmu_refused(f, "a variable of `reinit` does not follow from one state");
    default: return fmu_refused(f, "no value of a state gives a variable the value of its `reinit`");
  }
}

/* ------------------------------------------------------------------ roots */

/* Relations, then what assertions depend on, then laws. */
int64_t fmu_roots(const fmu *f) { return lmoc_roots(&f->e) + f->model->events.branches + fmu_law_roots(f); }

/* The zero functions as last looked at. */
static double *zeros_of(fmu *f) {
  for (int64_t k = 0; k < f->e.zeros; k++) f->noise[k] = fmu_value(f, k);
  return f->noise;
}

int fmu_indicators(fmu *f, double time, const double *x, double *out) {
  const fmu_events *e = &f->model->events;
  const int64_t roots = lmoc_roots(&f->e);
  if (fmu_look(f, time, x)) return FMU_NO_VALUE;
  lmoc_root_values(&f->e, zeros_of(f), out);
  for (int64_t k = 0; k < f->e.zeros; k++) /* solvers take what is zero for no indicator */
    if (out[k] == 0) out[k] = lmoc_rounded(&f->e, k) || f->e.v[f->e.target[f->e.of_zero[k]]] > 0 ? LEAST : -LEAST;
  for (int64_t i = 0; i < e->branches; i++) out[roots + i] = f->w[LOOK][e->branch[i]];
  fmu_law_indicators(f, out + roots + e->branches);
  for (int64_t k = roots + e->branches; k < fmu_roots(f); k++) if (out[k] == 0) out[k] = LEAST;
  return FMU_GOOD;
}

void fmu_sides(const fmu *f, double *out) {
  const int64_t roots = lmoc_roots(&f->e);
  lmoc_root_sides(&f->e, out);
  for (int64_t i = 0; i < f->model->events.branches; i++) out[roots + i] = 0;
  for (int64_t i = roots + f->model->events.branches; i < fmu_roots(f); i++) out[i] = 1;
}

int fmu_asks(fmu *f, const double *values) {
  const int64_t count = fmu_roots(f);
  double *sides = f->root + count;
  fmu_sides(f, sides);
  for (int64_t k = 0; k < count; k++) if (values[k] * sides[k] < 0) return 1;
  return 0;
}

int fmu_passed(fmu *f) {
  if (f->now.parted || f->now.drifted) return 1;
  return fmu_roots(f) && !fmu_indicators(f, f->now.time, f->x, f->root) && fmu_asks(f, f->root);
}

void fmu_seen(fmu *f) { lmoc_seen(&f->e, zeros_of(f)); }

void fmu_followed(fmu *f) { lmoc_followed(&f->e); }

/* What `engine/c/roots.c` asks within a step: where the states come from, constant where there are none. */
typedef struct {
  fmu *f;
  int (*states)(void *own, double time, double *x);
  void *own;
} curve;

static int values_at(void *own, int64_t count, const double *times, double *out) {
  const curve *c = own;
  fmu *f = c->f;
  const int64_t roots = fmu_roots(f);
  double *x = f->moved + 4*f->model->states;
  for (int64_t i = 0; i < count; i++, out += roots) {
    if (c->states) c->states(c->own, times[i], x);
    if (fmu_indicators(f, times[i], x, out)) for (int64_t k = 0; k < roots; k++) out[k] = NAN;
    else fmu_seen(f);
  }
  return 0;
}

int fmu_first_root(fmu *f, double begin, double end, int (*states)(void *own, double time, double *x), void *own,
                   double *time) {
  curve c = {f, states, own};
  lmoc_finder *finder = &f->finder;
  finder->count = fmu_roots(f);
  finder->signs = f->root + finder->count;
  finder->owner = &c;
  finder->values = values_at;
  fmu_sides(f, finder->signs);
  lmoc_roots_of_step(finder, begin, end);
  const int found = lmoc_next_root(finder, time);
  fmu_followed(f);
  if (found == LMOC_ROOTS_NO_MEMORY) return fmu_refused(f, "there is no memory to look for events");
  if (found == LMOC_NO_ROOT) *time = INFINITY;
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ events */

static int is_crossed(double now, double then) { return now < 0 || (then < 0 && then < now); }

/* Which zero functions are beyond their side, 1 (of rounded ones 2 at the upper edge), or will be so soon that it is the
   same instant; and which functions of laws, `law_which`. */
static int crossed(fmu *f, double *which) {
  const lmoc_instant *e = &f->e;
  const int64_t count = fmu_roots(f), n = f->model->states;
  const double t = f->now.time, ahead = 1e-14 * fmax(fabs(t), fabs(f->now.begin)) + 1e-12 * (t - f->now.begin);
  double *values = f->root, *sides = values + count, *later = sides + count, *x = f->moved;
  const int64_t first = count - fmu_law_roots(f);
  for (int64_t k = 0; k < e->zeros; k++) which[k] = 0;
  if (!count) return FMU_GOOD;
  if (fmu_indicators(f, t, f->x, values)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < n; i++) x[i] = f->x[i] + ahead * f->w[RIGHT][f->model->derivative[i]];
  if (!(t > f->now.last_instant) || fmu_indicators(f, t + ahead, x, later)) memcpy(later, values, count * sizeof(double));
  fmu_sides(f, sides);
  for (int64_t k = 0, upper = e->zeros; k < e->zeros; k++)
    for (int64_t edge = 0, at = k; edge < 1 + lmoc_rounded(e, k); edge++, at = upper++) {
      const double now = values[at] * sides[at], then = later[at] * sides[at];
      if (is_crossed(now, then)) which[k] = 1 + (double)edge;
    }
  for (int64_t k = first; k < count; k++) {
    /* the closure of a loop is another one by rounding each time: what has been located happens, else it is so for ever */
    f->law_which[k - first] = is_crossed(values[k], later[k]) || (f->located && f->finder.which[k]);
  }
  return FMU_GOOD;
}

/* The motion with the present discrete values, which `engine/c/hops.c` looks along. */
static int motion(lmoc_instant *e, double time, const double *x, double *rates, double *zeros) {
  fmu *f = e->owner;
  const int lost = fmu_look(f, time, x);
  for (int64_t i = 0; i < e->states; i++) rates[i] = lost ? NAN : f->w[RIGHT][f->model->derivative[i]];
  for (int64_t k = 0; k < e->zeros; k++) zeros[k] = lost ? NAN : fmu_value(f, k);
  return LMOC_SETTLED;
}

/* What the event's own conditions say of it. */
static int judge(fmu *f) {
  const fmu_events *e = &f->model->events;
  for (int64_t i = 0; i < f->e.found_count; i++) {
    const int64_t k = f->e.found[i];
    const int wrong = k < e->checks && e->check_error[k];
    if (k >= e->checks && f->now.ended) continue;
    (wrong ? f->tell : f->warn)(f->owner, e->told_texts[k]);
    if (wrong) return FMU_WRONG;
    if (k >= e->checks) f->now.ended = 1;
  }
  return FMU_GOOD;
}

/* Tell of the relations that have changed. */
static void note(const fmu *f, const double *before) {
  const lmoc_instant *e = &f->e;
  char text[400];
  for (int64_t i = 0; i < e->discrete; i++) {
    const double now = e->v[e->own[i]];
    int64_t r = now == before[i] ? e->relations : 0;
    while (r < e->relations && e->target[r] != e->own[i]) r++;
    if (r == e->relations) continue;
    snprintf(text, sizeof text, "t = %.15g s: %.250s: relation, now %.9g", f->now.time, f->model->events.texts[r], now);
    f->note(f->owner, text);
  }
}

/* What an event has done, beside what the engine knows of: values step that the motion needs, and something is said. */
static int happened(lmoc_events *v, double time, double *x) {
  fmu *f = v->owner;
  int found;
  (void)time, (void)x; /* which stand in `f` */
  f->now.jumped |= v->jumped != 0;
  if (v->kind != LMOC_START) note(f, v->held);
  fmu_changed(f);
  if (v->kind != LMOC_START && (found = fmu_discrete_steps(f, v->held))) return found;
  v->jumped |= f->now.jumped;
  return judge(f);
}

/* Say why nothing is known behind an instant. */
static int reported(fmu *f, int found) {
  const char *how = found == LMOC_TOO_LOW ? "its next hop is too low to be told from none" : "a friction with a stick mode ends that";
  char text[400];
  if (found == LMOC_UNSETTLED) return fmu_unsettled(f);
  if (found != LMOC_TOO_LOW && found != LMOC_TOO_OFTEN) return found;
  snprintf(text, sizeof text, "%.250s switches back and forth: %s", f->model->events.texts[f->e.of_zero[f->events.culprit]], how);
  return fmu_refused(f, text);
}

void fmu_allow(fmu *f) {
  for (int64_t j = 0; j < f->model->states; j++)
    f->errors[j] = f->now.rtol * (fabs(f->x[j]) + 1e-3 * f->model->nominal[j]);
}

/* What happens to the discrete values; `which` as of `crossed`. `alone`: nothing else has happened. */
static int change(fmu *f, int alone) {
  int some = 0;
  for (int64_t k = 0; k < f->e.zeros; k++) some |= f->which[k] != 0;
  f->hops.begin = f->now.begin;
  fmu_allow(f);
  f->events.errors = alone ? f->errors : 0;
  const int found = lmoc_events_after(&f->events, f->now.time, f->x, some);
  return reported(f, found == LMOC_OVER ? lmoc_events_settle(&f->events, f->now.time, f->x) : found);
}

/* Carry out the discrete equations where a law has changed something. */
static int answer(void *own, double time, double *x) {
  fmu *f = own;
  (void)time, (void)x; /* which stand in `f` */
  return (f->failed = reported(f, lmoc_events_settle(&f->events, f->now.time, f->x))) != FMU_GOOD;
}

/* Whether something happens to laws. */
static int laws_change(const fmu *f) {
  int some = f->now.parted;
  for (int64_t k = 0; k < fmu_law_roots(f); k++) some |= f->law_which[k];
  return some;
}

/* Laws go first, then the discrete equations, and the laws again where those have changed something. */
int fmu_happen(fmu *f) {
  const int64_t laws = f->model->laws.laws.count;
  const int64_t kinks = f->now.first_break;
  int found, some;
  f->now.jumped = 0;
  if (f->model->loops.stages && (found = fmu_loops_return(f))) return found;
  if ((found = fmu_input_steps(f))) return found;
  f->now.anew = f->now.jumped || f->now.first_break != kinks;
  if (f->now.ended || !(f->e.discrete || laws)) return FMU_GOOD;
  fmu_settle(f);
  fmu_law_given(f); /* what discrete values change now is a step for the laws */
  if ((found = crossed(f, f->which))) return found;
  if ((some = laws_change(f)) && (found = fmu_law_happen(f, f->law_which))) return found;
  if (f->e.discrete) {
    memcpy(f->law_before, f->x, f->model->states * sizeof(double));
    if ((found = change(f, !some && !f->now.jumped)) || (laws && (found = fmu_law_settle(f, answer)))) return found;
  }
  f->now.last_instant = f->now.time;
  f->now.anew |= some || f->now.jumped || (f->now.turned == f->now.time && f->now.time > f->now.begin);
  if (f->now.jumped && f->model->loops.stages && (found = fmu_loops_stand(f))) return found;
  if (fmu_look(f, f->now.time, f->x)) return FMU_NO_VALUE;
  fmu_law_watch(f);
  lmoc_mark(&f->call);
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ the start, and assertions about the motion */

/* Discrete variables with an equation at the start have that value, and have had it. */
static int begin_with(lmoc_events *v, int first) {
  fmu *f = v->owner;
  const fmu_events *m = &f->model->events;
  lmoc_instant *e = &f->e;
  int found;
  if (first) {
    if ((found = e->look(e, f->now.time, f->x))) return found; /* which brings the parameters */
    lmoc_remember(e);
  }
  for (int64_t i = 0; i < e->discrete; i++) f->w[BEGIN][e->own[i]] = e->v[e->own[i]];
  for (int64_t i = 0; i < m->seen; i++) f->w[BEGIN][m->seen_registers[i]] = e->v[m->seen_registers[i]];
  lmoc_tape_run(f->now.time, f->w[BEGIN], f->tape + BEGIN);
  for (int64_t i = 0; i < m->begun; i++) e->v[m->begun_ones[i]] = f->w[BEGIN][m->begun_ones[i]];
  return FMU_GOOD;
}

void fmu_ask_events(fmu *f) {
  f->hops.motion = motion;
  f->hops.step = INFINITY;
  f->hops.span = f->model->span;
  f->events.e = &f->e;
  f->events.h = &f->hops;
  f->events.next = &f->now.next;
  f->events.turned = &f->now.turned;
  f->events.initial = f->model->events.initial;
  f->events.terminal = -1; /* nobody knows when the other side ends */
  f->events.owner = f;
  f->events.happened = happened;
  f->events.equations = begin_with;
}

/* Discrete values that agree with each other and with the states. `for_good`: with the events of the start, else only to
   be looked at. */
static int begin_discrete(fmu *f, int for_good) {
  lmoc_instant *e = &f->e;
  for (int64_t i = 0; i < e->discrete; i++) e->v[e->own[i]] = f->model->events.start[i];
  for (int64_t i = 0; i < f->model->jumps.early; i++) e->early[f->model->jumps.early_ones[i]] = 1;
  const int found = lmoc_events_start(&f->events, f->now.time, f->x, !for_good);
  if (found) return reported(f, found);
  fmu_changed(f);
  if (for_good) f->now.last_instant = f->now.time;
  return FMU_GOOD;
}

int fmu_begin(fmu *f, int for_good) {
  const int64_t laws = f->model->laws.laws.count;
  const double t = f->now.time;
  int found = FMU_GOOD;
  f->now.settled = 1;
  f->now.jumped = 0;
  f->now.begun |= for_good;
  if (f->model->loops.stages && (found = fmu_loops_begin(f))) return found;
  if (f->e.discrete && (found = begin_discrete(f, for_good))) return found;
  if (for_good && (found = fmu_input_steps(f))) return found;
  if (laws && (found = fmu_law_begin(f, for_good))) return found;
  if (laws && f->e.discrete && for_good) {
    memcpy(f->law_before, f->x, f->model->states * sizeof(double));
    if ((found = fmu_law_settle(f, answer))) return found;
  }
  if (for_good && f->model->loops.stages && (found = fmu_loops_stand(f))) return found;
  if (fmu_look(f, t, f->x)) return FMU_NO_VALUE;
  if (laws) fmu_law_watch(f);
  if (for_good) lmoc_mark(&f->call);
  return FMU_GOOD;
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
