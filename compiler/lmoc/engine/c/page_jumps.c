/* Steps in a scene of a page: what inputs and discrete values decide about while the equations hold derivatives of it, and
   what that does to the states (`jump.c`). */

#include "page_scene.h"

#include <stdlib.h>

static const double LOCATED = 1e-14; /* s, or this share of the time: so exactly are instants located */

/* The rates with all laws open, and what is judged, from the registers as they stand. */
static int values(void *owner, const double *x, const int32_t *which, const double *given, double *out) {
  const lmoc_page *p = owner;
  const page_jumps *j = &p->jumps;
  double *w = j->w;
  memcpy(w, p->w, (size_t)p->size * sizeof(double));
  for (int64_t i = 0; i < p->n; i++) w[p->states[i]] = x[i];
  for (int64_t i = 0; i < j->jump.given; i++) {
    w[j->own[i]] = w[j->registers[i]];
    w[j->which[i]] = which[i];
    w[j->value[i]] = given[i];
  }
  const int lost = lmoc_tape_run(p->instant, w, &p->programs[j->rates].program.tape) & LMOC_FAILED;
  for (int64_t i = 0; i < p->n + j->jump.judged; i++) out[i] = w[j->results[i]];
  return lost;
}

/* ------------------------------------------------------------------ reading */

static int make_room(page_jumps *j, int64_t n) {
  const int64_t one = j->count + 1, all = one + j->jump.given;
  double *at = calloc((size_t)(6*one + 2*all + 2*n), sizeof(double));
  if (!at) return 0;
#define TAKE(name, size) (j->name = at, at += (size))
  TAKE(seen, 4*one), TAKE(sides, 2*one), TAKE(old, all), TAKE(change, all), TAKE(moved, n), TAKE(before, n);
#undef TAKE
  return 1;
}

void lmoc_page_read_jumps(lmoc_page *p, lmoc_bytes *b) {
  page_jumps *j = &p->jumps;
  lmoc_jump *own = &j->jump;
  int64_t count;
  if (!lmoc_read_integer(b)) return;
  j->look = lmoc_read_integer(b);
  j->rates = lmoc_read_integer(b);
  j->stored = lmoc_read_integer(b);
  j->work = lmoc_read_integer(b);
  j->count = lmoc_read_integer(b);
  j->registers = lmoc_read_integers(b, &own->given);
  const int32_t **tables[] = {&j->which, &j->value, &j->own, &own->upper, &own->origin, &own->second, &own->ledger};
  own->lower = lmoc_read_integers(b, &own->rows);
  for (size_t k = 0; k < sizeof tables / sizeof *tables; k++) *tables[k] = lmoc_read_integers(b, &count);
  j->results = lmoc_read_integers(b, &count);
  own->judged = count - p->n;
  j->early = lmoc_read_integers(b, &j->early_count);
  own->states = p->n;
  own->owner = p;
  own->values = values;
  if (b->failed || own->judged < 0 || j->look >= p->program_count || j->rates >= p->program_count || !make_room(j, p->n)) b->failed = 1;
}

/* ------------------------------------------------------------------ what steps */

static int read_at(lmoc_page *p, double time, const double *x, double *out) {
  const page_jumps *j = &p->jumps;
  memcpy(p->x, x, (size_t)p->n * sizeof(double));
  p->switched = 1;
  const int lost = lmoc_page_evaluate(p, (int)j->look, time) & LMOC_FAILED;
  for (int64_t k = 0; k < j->count; k++) out[k] = p->w[j->registers[k]];
  out[j->count] = j->stored < 0 ? 0 : p->w[j->stored];
  return lost;
}

/* The work of the source: what is stored more; no number where a damper takes up any power. */
static int book(lmoc_page *p) {
  page_jumps *j = &p->jumps;
  const double stored = j->sides[j->count];
  const int status = lmoc_jump_work(&j->jump, j->old, j->change, j->before);
  if (status == LMOC_JUMP_ENDLESS) {
    j->unbooked = 1;
    return 0;
  }
  if (status || j->stored < 0) return status;
  if (read_at(p, p->instant, p->answer, j->seen)) return LMOC_JUMP_NO_VALUE;
  if (j->work >= 0) p->answer[j->work] += j->seen[j->count] - stored;
  return 0;
}

/* What the values seen, (4, count + 1), do to the answer: 0, or why there is no way. */
static int step(lmoc_page *p) {
  page_jumps *j = &p->jumps;
  const int64_t n = p->n, given = j->jump.given;
  const size_t size = (size_t)n * sizeof(double);
  int laws = p->laws.run.k.laws.count > 0, failed = 0;
  j->unbooked = j->some = 0;
  lmoc_steps_between(j->count + 1, j->seen, j->sides, j->change);
  memset(j->old, 0, (size_t)given * sizeof(double));
  memcpy(j->old, j->sides, (size_t)j->count * sizeof(double));
  for (int64_t k = j->count; k < given; k++) j->change[k] = 0;
  for (j->first = 0; j->first < j->count && j->change[j->first] == 0;) j->first++;
  if (j->first == j->count) return 0;
  memcpy(j->before, p->answer, size);
  if (laws) lmoc_page_open(p);
  lmoc_page_sample(p, p->instant);
  int status = lmoc_jump_states(&j->jump, j->old, j->change, j->before, j->moved);
  for (int64_t i = 0; i < n && !status; i++) {
    p->answer[i] += j->moved[i];
    j->some |= j->moved[i] != 0;
  }
  if (!status) status = book(p);
  if (!status && j->some && laws) failed = lmoc_law_strike(&p->laws.run, p->instant, j->before, p->answer);
  if (laws) lmoc_page_hold(p);
  p->switched = 1;
  return status ? -status : failed ? LMOC_STRUCK - failed : 0;
}

int lmoc_page_discrete_steps(lmoc_page *p, double time) {
  page_jumps *j = &p->jumps;
  page_events *v = &p->events;
  const lmoc_instant *e = &v->instant;
  const size_t one = (size_t)(j->count + 1) * sizeof(double);
  j->some = j->unbooked = 0;
  if (!j->count) return 0;
  p->instant = time;
  for (int64_t i = 0; i < e->discrete; i++) {
    v->now[i] = e->v[e->own[i]];
    e->v[e->own[i]] = v->way.held[i];
  }
  int lost = read_at(p, time, p->answer, j->seen);
  for (int64_t i = 0; i < e->discrete; i++) e->v[e->own[i]] = v->now[i];
  lost |= read_at(p, time, p->answer, j->seen + 2*(j->count + 1));
  if (lost) return LMOC_NO_VALUE;
  memcpy(j->seen + j->count + 1, j->seen, one);
  memcpy(j->seen + 3*(j->count + 1), j->seen + 2*(j->count + 1), one);
  const int found = step(p);
  if (j->some) v->way.jumped = 1;
  return found;
}

/* ------------------------------------------------------------------ times */

double *lmoc_page_step_times(lmoc_page *p, int count, double begin) {
  page_jumps *j = &p->jumps;
  free(j->times);
  j->times = calloc((size_t)count + 1, sizeof(double));
  j->time_count = j->times ? count : 0;
  j->passed = 0;
  j->begin = begin;
  return j->times;
}

double lmoc_page_next_step(const lmoc_page *p) {
  const page_jumps *j = &p->jumps;
  return j->passed < j->time_count ? j->times[j->passed] : INFINITY;
}

static double near(const lmoc_page *p, double time) { return LOCATED * fmax(fabs(time), fabs(p->jumps.begin)); }

int lmoc_page_steps_at(const lmoc_page *p, double time) { return fabs(lmoc_page_next_step(p) - time) <= near(p, time); }

int lmoc_page_input_steps(lmoc_page *p, double time) {
  static const double places[] = {-1, -2, 1, 2};
  page_jumps *j = &p->jumps;
  const double aside = lmoc_beside_step(time);
  int lost = 0;
  memcpy(p->answer, p->x, (size_t)p->n * sizeof(double));
  p->instant = time;
  if (!lmoc_page_steps_at(p, time)) return 0;
  if (p->laws.run.k.laws.count) lmoc_page_open(p);
  for (int k = 0; k < 4; k++) lost |= read_at(p, time + places[k] * aside, p->answer, j->seen + k*(j->count + 1));
  if (p->laws.run.k.laws.count) lmoc_page_hold(p);
  while (j->passed < j->time_count && j->times[j->passed] <= time + near(p, time)) j->passed++;
  return lost ? LMOC_NO_VALUE : step(p);
}

double lmoc_page_stepped(const lmoc_page *p, int which) {
  const page_jumps *j = &p->jumps;
  const double all[] = {(double)j->first, j->old[j->first], j->old[j->first] + j->change[j->first], j->some, j->unbooked};
  return all[which];
}
