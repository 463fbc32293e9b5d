/* Segments that laws or events end (`segments.h`). */

#include "segments.h"

#include "roots.h"

#include <math.h>
#include <string.h>

static const double NO_TIME = 1e-15;  /* share of the time: in a shorter segment nothing moves */
static const double LOCATED = 1e-14;  /* share of the time by which the place of a root may be wrong */

enum { FAILED, REACHED, CROSSED };    /* what a segment comes to: what ends it is left to others, or is its time, or a root */

/* A segment under way: functions along its steps, and room. */
typedef struct {
  lmoc_segments *s;
  lmoc_finder finder;
  lmoc_step_functions along;
  lmoc_watched own;
  double until;                       /* s */
  double *place, *x, *places, *rates; /* (n,), (n,), (2, n), (n,) */
  double *signs, *values, *read, *kept; /* (functions,), (2, functions), (2, …), all pieces */
  uint8_t *which;
  lmoc_flag *every;                   /* (2 laws,) */
} lmoc_under_way;

/* ------------------------------------------------------------------ what stays as it is during a segment */

/* Give all programs the registers in the mode that holds, and with the present discrete values; they are left in `base`. */
static void give(const lmoc_segments *s, double *base) {
  const lmoc_law_run *laws = s->laws;
  memcpy(base, s->open, (size_t)s->registers * sizeof(double));
  if (s->book) {
    const lmoc_instant *e = s->book->v->e;
    for (int64_t i = 0; i < e->discrete; i++) base[s->discrete[i]] = e->v[e->own[i]];
  }
  if (laws) {
    lmoc_law_inputs(laws, laws->inputs);
    for (int64_t i = 0; i < s->shown; i++) base[s->places[i]] = laws->inputs[s->numbers[i]];
    for (int64_t j = 0; j < laws->k.states; j++) if (laws->held[j]) base[s->held[j]] = 1;
  }
  for (int64_t i = 0; i < s->programs; i++) {
    const lmoc_given *own = s->program + i;
    memcpy(own->w, base, (size_t)s->registers * sizeof(double));
    lmoc_forget(own->tape, own->blocks);
    if (own->call) own->call->solved = own->call->marked = 0;
  }
}

/* What is read for the functions, at some places. */
static void read_at(const lmoc_segments *s, int64_t count, const double *times, const double *x, double *out) {
  const lmoc_watched *w = s->watched;
  const double none = 0;
  uint8_t good[2];
  lmoc_evaluate_many(w->call, count, times, x, &none, w->chosen, w->registers, out, good);
}

/* The laws that are watched by two functions: their forces have a lower limit as well. */
static int is_second(const lmoc_law_run *laws, int64_t i) { return laws->closed[i] && !laws->k.laws.complementary[i]; }

/* Begin to watch; `signs` of the functions. How many they are. */
static int64_t watch(const lmoc_segments *s, double *signs) {
  if (!s->watched) return 0;
  if (!s->laws) {
    lmoc_root_sides(s->book->v->e, signs);
    return lmoc_roots(s->book->v->e);
  }
  int64_t count = s->laws->k.laws.count;
  read_at(s, 1, &s->time, s->x, s->watched->read);
  lmoc_law_watch(s->laws, s->watched->read);
  for (int64_t i = 0; i < s->laws->k.laws.count; i++) count += is_second(s->laws, i);
  for (int64_t i = 0; i < count; i++) signs[i] = 1;
  return count;
}

/* ------------------------------------------------------------------ output */

static int is_same(double time, double event) { return 0 <= event - time && event - time <= LOCATED * fabs(event); }

/* The states at the output times of the last step up to a time. */
static void show(lmoc_segments *s, double until) {
  const int64_t n = s->taylor->call->n;
  for (double h; s->reached < s->outputs && s->times[s->reached] <= until; s->reached++) {
    h = s->times[s->reached] - s->walk->before[0];
    lmoc_taylor_values(n, s->taylor->order, 1, &h, s->walk->q, s->out + s->reached * n);
  }
}

/* ------------------------------------------------------------------ the way to its end */

/* Steps up to the first root, or to the end of the segment. */
static int find(lmoc_under_way *u, double *time) {
  lmoc_segments *s = u->s;
  lmoc_walk *walk = s->walk;
  const int64_t n = s->taylor->call->n;
  int64_t tried = 0;
  walk->time[0] = walk->before[0] = s->time;
  walk->begins[0] = 0;
  walk->end = u->until;
  memcpy(walk->x, s->x, (size_t)n * sizeof(double));
  s->evaluations++;
  if (lmoc_taylor_series(s->taylor, s->time, walk->x, walk->next)) return FAILED;
  walk->most[0] = 1;
  walk->outputs[0] = 0;
  walk->hook = 0;
  while (tried < s->most) {
    u->along.begin = walk->time[0];
    memcpy(u->place, walk->x, (size_t)n * sizeof(double));
    const int stopped = lmoc_taylor_walk(s->taylor, walk);
    tried += walk->tries[0];
    s->tries += walk->tries[0];
    s->steps += walk->steps[0];
    s->evaluations += walk->tries[0];
    if (stopped) return FAILED;
    u->along.end = walk->time[0];
    u->along.before = walk->before[0];
    u->along.last = walk->x;
    u->along.series = walk->q;
    if (u->finder.count) {
      lmoc_roots_of_step(&u->finder, walk->before[0], walk->time[0]);
      const int found = lmoc_next_root(&u->finder, time);
      if (found == LMOC_ROOT) return CROSSED;
      if (found != LMOC_NO_ROOT) return FAILED;
    }
    *time = walk->time[0];
    if (!(*time < u->until)) return s->book ? REACHED : FAILED;
    show(s, *time);
  }
  return FAILED;
}

/* ------------------------------------------------------------------ the instant */

/* With the root, all functions that vanish more closely than its place is known. */
static int together(lmoc_under_way *u, double time, const double *x) {
  lmoc_segments *s = u->s;
  const int64_t n = s->taylor->call->n, count = u->finder.count;
  const double ahead = lmoc_located(time, s->begin), times[] = {time, time + ahead};
  int all = !s->book;
  for (int64_t i = 0; i < count; i++) all &= u->which[i];
  if (all || !count || !(time > s->last)) return 1;
  if (lmoc_evaluate(s->rates, time, x)) return 0;
  for (int64_t j = 0; j < n; j++) u->rates[j] = s->rates->w[s->rates->derivatives[j]];
  for (int64_t j = 0; j < n; j++) {
    u->places[j] = x[j];
    u->places[n + j] = x[j] + ahead * u->rates[j];
  }
  read_at(s, 2, times, u->places, u->read);
  if (s->laws) lmoc_law_values(s->laws, 2, u->read, u->values);
  else lmoc_follow(s->book->v->e, 2, u->read, u->values);
  for (int64_t i = 0; i < count; i++) {
    const double now = u->values[i] * u->signs[i], soon = u->values[count + i] * u->signs[i];
    u->which[i] |= soon < 0 && soon < now;
  }
  return 1;
}

/* What the laws do there; `x` is moved on. Returns whether that is beyond doubt. */
static int of_laws(const lmoc_under_way *u, double time, double *x) {
  const lmoc_segments *s = u->s;
  const int64_t n = s->taylor->call->n, m = s->laws->k.laws.count;
  for (int64_t j = 0; j < n; j++) {
    s->errors[j] = s->walk->rtol[0] * fabs(x[j]) + s->walk->atol[j];
    s->unresolved[j] = 0;
  }
  for (int64_t i = 0, at = m; i < m; i++) {
    u->every[i] = u->which[i];
    u->every[m + i] = is_second(s->laws, i) && u->which[at++];
  }
  if (lmoc_law_happen(s->laws, time, x, u->every, 0)) return 0;
  for (int64_t i = 0; i < m; i++) if (s->laws->undecided[i]) return 0;
  return 1;
}

/* Whether a function crosses zero that has done so just before, and the motion is the same since: steps may leave open
   whether it has left zero. */
static int comes_again(const lmoc_segments *s, double time) {
  const lmoc_events *v = s->book->v;
  const double since = fmax(s->book->turned, time - s->shortly);
  for (int64_t k = 0; k < v->e->zeros; k++)
    if (v->which[k] != 0 && v->h->times[k*LMOC_CHATTER + LMOC_CHATTER - 1] > since) return 1;
  return 0;
}

/* The same of the events. */
static int of_events(const lmoc_under_way *u, double time, double *x) {
  const lmoc_segments *s = u->s;
  const lmoc_events *v = s->book->v;
  const lmoc_instant *e = v->e;
  int some = 0;
  for (int64_t k = 0, upper = e->zeros; k < e->zeros; k++) {
    const int up = lmoc_rounded(e, k) && u->which[upper++];
    v->which[k] = up ? 2 : u->which[k] ? 1 : 0;
    some |= v->which[k] != 0;
  }
  if (some && comes_again(s, time)) return 0;
  v->h->step = s->walk->length[0];
  return !lmoc_events_after(s->book->v, time, x, some);
}

/* ------------------------------------------------------------------ one after the other */

static void keep(const lmoc_under_way *u, double *kept) {
  const lmoc_segments *s = u->s;
  double *to = u->kept;
  for (int64_t i = 0; i < s->pieces; to += s->piece[i++].count)
    memcpy(to, s->piece[i].at, (size_t)s->piece[i].count * sizeof(double));
  if (!s->laws) return;
  memcpy(kept, s->memory, (size_t)s->size * sizeof(double));
  kept[s->size] = s->laws->until;
  kept[s->size + 1] = (double)s->laws->law;
}

static void go_back(const lmoc_under_way *u, const double *kept) {
  const lmoc_segments *s = u->s;
  const double *from = u->kept;
  for (int64_t i = 0; i < s->pieces; from += s->piece[i++].count)
    memcpy(s->piece[i].at, from, (size_t)s->piece[i].count * sizeof(double));
  if (!s->laws) return;
  memcpy(s->memory, kept, (size_t)s->size * sizeof(double));
  s->laws->until = kept[s->size];
  s->laws->law = (int64_t)kept[s->size + 1];
}

/* When what has been found happens: with the next time event, where it is as near as that. */
static double instant(const lmoc_segments *s, double time, int found) {
  const double next = s->book ? *s->book->v->next : INFINITY;
  return found == CROSSED && fabs(next - time) <= lmoc_located(time, s->begin) ? next : time;
}

/* One segment, and what happens at its end; returns whether all was as usual. */
static int segment(lmoc_under_way *u, int64_t k) {
  lmoc_segments *s = u->s;
  const int64_t n = s->taylor->call->n;
  const size_t size = (size_t)n * sizeof(double);
  double time;
  u->until = s->book ? fmin(s->end, *s->book->v->next) : s->end;
  if (!(u->until - s->time > NO_TIME * fmax(fabs(s->time), fabs(u->until)))) return 0;
  if (s->laws && lmoc_law_drifts(s->laws)) return 0;
  give(s, s->base + k * s->registers);
  u->own.count = u->along.count = u->finder.count = watch(s, u->finder.signs);
  memcpy(u->signs, u->finder.signs, (size_t)u->finder.count * sizeof(double));
  u->along.largest = s->largest + k*n;
  for (int64_t j = 0; j < n; j++) u->along.largest[j] = fabs(s->x[j]);
  const int found = find(u, &time);
  if (!found) return 0;
  if (found == CROSSED) lmoc_step_states(&u->along, time, u->x);
  else memcpy(u->x, s->walk->x, size);
  show(s, time);
  if (fabs(s->end - time) <= lmoc_near_to(time)) return 0;
  for (int64_t i = 0; i < u->finder.count; i++) u->which[i] = found == CROSSED && u->finder.which[i];
  time = instant(s, time, found);
  if (!together(u, time, u->x)) return 0;
  if (!(s->laws ? of_laws(u, time, u->x) : of_events(u, time, u->x))) return 0;
  if (s->reached > s->first && is_same(s->times[s->reached - 1], time)) s->reached--; /* the next one has it */
  s->until[k] = s->first = s->reached;
  if (s->book) s->booked[k] = s->book->filled;
  s->ended[k] = s->last = s->time = time;
  memcpy(s->x, u->x, size);
  memcpy(s->states + k*n, u->x, size);
  if (s->reached < s->outputs && is_same(s->times[s->reached], time)) memcpy(s->out + s->reached++ * n, u->x, size);
  return 1;
}

int64_t lmoc_segments_go(lmoc_segments *s) {
  const int64_t n = s->taylor->call->n, most = s->functions, row = s->size + 2;
  double *at = s->work;
  lmoc_under_way u = {.s = s, .place = at, .x = at + n, .places = at + 2*n, .rates = at + 4*n, .signs = at + 7*n};
  int64_t done = 0;
  u.values = u.signs + most;
  u.finder = (lmoc_finder){.signs = u.values + 2*most, .which = (uint8_t *)(u.values + 3*most), .owner = &u.along,
                           .values = lmoc_step_values, .quiet = lmoc_step_quiet};
  u.which = u.finder.which + most;
  u.every = u.which + most;
  u.read = u.values + 5*most;
  u.kept = u.read;
  if (s->watched) {
    u.own = *s->watched;
    u.kept += 2 * s->watched->chosen;
  }
  u.along = (lmoc_step_functions){.n = n, .parts = s->watched != 0, .part = &u.own, .x = at + 5*n, .first = u.place,
                                  .order = s->taylor->order};
  keep(&u, s->kept);
  while (done < s->room) {
    const lmoc_segments before = *s;
    const int64_t booked = s->book ? s->book->filled : 0;
    if (!segment(&u, done)) {
      go_back(&u, s->kept + done*row);
      *s = before;
      if (s->book) s->book->filled = booked;
      break;
    }
    keep(&u, s->kept + ++done*row);
  }
  lmoc_roots_free(&u.finder);
  return done;
}
