/* Segments that laws end (`segments.h`). */

#include "segments.h"

#include "roots.h"

#include <math.h>
#include <string.h>

static const double NO_TIME = 1e-15;  /* share of the time: in a shorter segment nothing moves */
static const double NEAR = 4e-15;     /* share of the time by which two instants are one (`events/closeness.py`) … */
static const double LOCATED = 1e-14;  /* … by which the place of a root may be wrong, */
static const double OF_STEPS = 1e-12; /* with this share of the time since the start */

/* ------------------------------------------------------------------ what stays as it is during a segment */

/* Give all programs the registers in the mode that holds; they are left in `base`. */
static void give(const lmoc_segments *s, double *base) {
  const lmoc_law_run *laws = s->laws;
  memcpy(base, s->open, (size_t)s->registers * sizeof(double));
  lmoc_law_inputs(laws, laws->inputs);
  for (int64_t i = 0; i < s->shown; i++) base[s->places[i]] = laws->inputs[s->numbers[i]];
  for (int64_t j = 0; j < laws->k.states; j++) if (laws->held[j]) base[s->held[j]] = 1;
  for (int64_t i = 0; i < s->programs; i++) {
    const lmoc_given *own = s->program + i;
    memcpy(own->w, base, (size_t)s->registers * sizeof(double));
    lmoc_forget(own->tape, own->blocks);
    if (own->call) own->call->solved = own->call->marked = 0;
  }
}

/* What is read for the functions of laws, at some places. */
static void read_at(const lmoc_segments *s, int64_t count, const double *times, const double *x, double *out) {
  const lmoc_watched *w = s->watched;
  const double none = 0;
  uint8_t good[2];
  lmoc_evaluate_many(w->call, count, times, x, &none, w->chosen, w->registers, out, good);
}

/* The laws that are watched by two functions: their forces have a lower limit as well. */
static int is_second(const lmoc_law_run *laws, int64_t i) { return laws->closed[i] && !laws->k.laws.complementary[i]; }

static int64_t functions_of(const lmoc_law_run *laws) {
  int64_t count = laws->k.laws.count;
  for (int64_t i = 0; i < laws->k.laws.count; i++) count += is_second(laws, i);
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

/* ------------------------------------------------------------------ the way to a root */

/* Steps up to the first root; returns whether there is one. */
static int find(lmoc_segments *s, lmoc_finder *finder, lmoc_step_functions *along, double *time) {
  lmoc_walk *walk = s->walk;
  const int64_t n = s->taylor->call->n;
  double *place = s->work;
  int64_t tried = 0;
  walk->time[0] = walk->before[0] = s->time;
  walk->begins[0] = 0;
  memcpy(walk->x, s->x, (size_t)n * sizeof(double));
  s->evaluations++;
  if (lmoc_taylor_series(s->taylor, s->time, walk->x, walk->next)) return 0;
  walk->most[0] = 1;
  walk->outputs[0] = 0;
  walk->hook = 0;
  while (tried < s->most) {
    along->begin = walk->time[0];
    memcpy(place, walk->x, (size_t)n * sizeof(double));
    const int stopped = lmoc_taylor_walk(s->taylor, walk);
    tried += walk->tries[0];
    s->tries += walk->tries[0];
    s->steps += walk->steps[0];
    s->evaluations += walk->tries[0];
    if (stopped) return 0;
    along->end = walk->time[0];
    along->before = walk->before[0];
    along->first = place;
    along->last = walk->x;
    along->series = walk->q;
    lmoc_roots_of_step(finder, walk->before[0], walk->time[0]);
    const int found = lmoc_next_root(finder, time);
    if (found == LMOC_ROOT) return 1;
    if (found != LMOC_NO_ROOT || !(walk->time[0] < s->end)) return 0;
    show(s, walk->time[0]);
  }
  return 0;
}

/* ------------------------------------------------------------------ the instant */

/* With the root, all functions that vanish more closely than its place is known. */
static int together(const lmoc_segments *s, double time, const double *x, int64_t count, uint8_t *which) {
  const int64_t n = s->taylor->call->n;
  double *places = s->work + 2*n, *rates = places + 2*n, *read = s->work + 7*n, *values = read + 2*s->watched->chosen;
  const double ahead = LOCATED * fmax(fabs(time), fabs(s->begin)) + OF_STEPS * (time - s->begin);
  const double times[] = {time, time + ahead};
  int all = 1;
  for (int64_t i = 0; i < count; i++) all &= which[i];
  if (all || !(time > s->last)) return 1;
  if (lmoc_evaluate(s->rates, time, x)) return 0;
  for (int64_t j = 0; j < n; j++) rates[j] = s->rates->w[s->rates->derivatives[j]];
  for (int64_t j = 0; j < n; j++) {
    places[j] = x[j];
    places[n + j] = x[j] + ahead*rates[j];
  }
  read_at(s, 2, times, places, read);
  lmoc_law_values(s->laws, 2, read, values);
  for (int64_t i = 0; i < count; i++)
    which[i] |= values[count + i] < 0 && values[count + i] < values[i];
  return 1;
}

/* What the laws do there; `x` is moved on. Returns whether that is beyond doubt. */
static int happen(const lmoc_segments *s, double time, double *x, const uint8_t *which) {
  const int64_t n = s->taylor->call->n, m = s->laws->k.laws.count;
  lmoc_flag *every = (lmoc_flag *)(s->work + 7*n + 2*s->watched->chosen + 4*m); /* (2 m,) */
  for (int64_t j = 0; j < n; j++) {
    s->errors[j] = s->walk->rtol[0] * fabs(x[j]) + s->walk->atol[j];
    s->unresolved[j] = 0;
  }
  for (int64_t i = 0, at = m; i < m; i++) {
    every[i] = which[i];
    every[m + i] = is_second(s->laws, i) && which[at++];
  }
  if (lmoc_law_happen(s->laws, time, x, every, 0)) return 0;
  for (int64_t i = 0; i < m; i++) if (s->laws->undecided[i]) return 0;
  return 1;
}

/* ------------------------------------------------------------------ one after the other */

static void keep(const lmoc_segments *s, double *kept) {
  memcpy(kept, s->memory, (size_t)s->size * sizeof(double));
  kept[s->size] = s->laws->until;
  kept[s->size + 1] = (double)s->laws->law;
}

static void go_back(const lmoc_segments *s, const double *kept) {
  memcpy(s->memory, kept, (size_t)s->size * sizeof(double));
  s->laws->until = kept[s->size];
  s->laws->law = (int64_t)kept[s->size + 1];
}

/* One segment, and what happens at its end; returns whether all was as usual. */
static int segment(lmoc_segments *s, int64_t k, lmoc_finder *finder) {
  const int64_t n = s->taylor->call->n;
  const size_t size = (size_t)n * sizeof(double);
  double *largest = s->largest + k*n, *x = s->work + n, time;
  if (!(s->end - s->time > NO_TIME * fmax(fabs(s->time), fabs(s->end))) || lmoc_law_drifts(s->laws)) return 0;
  give(s, s->base + k * s->registers);
  read_at(s, 1, &s->time, s->x, s->watched->read);
  lmoc_law_watch(s->laws, s->watched->read);
  lmoc_watched own = *s->watched;
  own.count = finder->count = functions_of(s->laws);
  lmoc_step_functions along = {.n = n, .parts = 1, .count = own.count, .part = &own, .largest = largest,
                               .x = s->work + 6*n, .order = s->taylor->order};
  for (int64_t j = 0; j < n; j++) largest[j] = fabs(s->x[j]);
  for (int64_t i = 0; i < own.count; i++) finder->signs[i] = 1;
  finder->owner = &along;
  if (!find(s, finder, &along, &time)) return 0;
  lmoc_step_states(&along, time, x);
  show(s, time);
  if (fabs(s->end - time) <= NEAR * fmax(fabs(time), 1e-300)) return 0;
  if (!together(s, time, x, own.count, finder->which) || !happen(s, time, x, finder->which)) return 0;
  if (s->reached > s->first && is_same(s->times[s->reached - 1], time)) s->reached--; /* the next one has it */
  s->until[k] = s->first = s->reached;
  s->ended[k] = s->last = s->time = time;
  memcpy(s->x, x, size);
  memcpy(s->states + k*n, x, size);
  if (s->reached < s->outputs && is_same(s->times[s->reached], time)) memcpy(s->out + s->reached++ * n, x, size);
  return 1;
}

int64_t lmoc_segments_go(lmoc_segments *s) {
  const int64_t n = s->taylor->call->n, m = s->laws->k.laws.count, row = s->size + 2;
  double *room = s->work + 7*n + 2*s->watched->chosen + 5*m;
  lmoc_finder finder = {.signs = room, .which = (uint8_t *)(room + 2*m), .values = lmoc_step_values,
                        .quiet = lmoc_step_quiet};
  int64_t done = 0;
  keep(s, s->kept);
  while (done < s->room) {
    const lmoc_segments before = *s;
    if (!segment(s, done, &finder)) {
      go_back(s, s->kept + done*row);
      *s = before;
      break;
    }
    keep(s, s->kept + ++done*row);
  }
  lmoc_roots_free(&finder);
  return done;
}
