/* Steps of a page's run: by DOP853, by Radau IIA where that is stiff, or through time alone where there are no states; and
   the functions whose signs end a piece of it. */

#include "page_scene.h"

#include <stdlib.h>

enum { EXPLICIT, IMPLICIT, STANDING };
enum { LOOKS = 400 };         /* at functions of time over a piece without states */
static const double BESIDE = 0.1;   /* of a part of a step, to both sides of a place: its slope is taken over that */
enum { DEFECTS = 8 };         /* parts of a step, between which it is looked at */
enum { MOST_STATES = 1000 };  /* of an implicit method, whose matrices have six times their square of numbers */

static double *state_of(lmoc_page *p) { return p->method == IMPLICIT ? p->radau.x : p->steps.x; }

static double time_of(const lmoc_page *p) { return p->method == IMPLICIT ? p->radau.t : p->steps.t; }

/* ------------------------------------------------------------------ begin */

void lmoc_page_begin(lmoc_page *p, double time, double end, double rtol, double longest, double first, double patience) {
  lmoc_steps *s = &p->steps;
  const lmoc_steps kept = *s;
  memcpy(s->x, p->x, p->n * sizeof(double));
  *s = (lmoc_steps){.call = &p->call, .rules = &p->rules, .weights = kept.weights, .nodes = kept.nodes,
                    .dense = kept.dense, .omitted = kept.omitted, .atol = p->atol, .x = kept.x, .f = p->f,
                    .x_new = kept.x_new, .k = kept.k, .last = kept.last, .terms = kept.terms, .t = time, .before = time,
                    .grow = p->rules.grow, .cuts_since = time, .rtol = rtol, .end = end, .max_step = longest,
                    .patience = patience, .most = 1, .out = p->answer, .outputs = 1, .room = 1, .step_size = first,
                    .hook = p->branches ? &p->hook : 0};
  p->rejected = p->evaluations = p->dense = 0;
  p->method = p->n ? EXPLICIT : STANDING;
  if (p->method == STANDING) s->length = fmin((end - time) / LOOKS, longest);
  else lmoc_page_jump(p);
  if (first > 0 || p->method == STANDING) return;
  const double h = lmoc_first_trial(p->n, end - time, longest, p->rules.least, rtol, p->atol, s->x, s->f);
  for (int64_t i = 0; i < p->n; i++) s->x_new[i] = s->x[i] + h*s->f[i];
  lmoc_derivatives(s->call, time + h, s->x_new, s->last);
  p->evaluations++;
  s->step_size = lmoc_first_step(p->n, h, end - time, rtol, p->atol, s->x, s->f, s->last);
}

static void rates(void *owner, double time, const double *x, double *out) {
  lmoc_page *p = owner;
  memmove(p->x, x, p->n * sizeof(double));
  lmoc_page_rates(p, time);
  memcpy(out, p->answer, p->n * sizeof(double));
}

static void mark(void *owner) { lmoc_page_mark(owner); }
static void go_back(void *owner) { lmoc_page_go_back(owner); }

int64_t lmoc_page_room_of_radau(lmoc_page *p) {
  p->radau = (lmoc_radau){.n = p->n};
  return p->n > MOST_STATES ? 0 : lmoc_radau_place(&p->radau, 0);
}

int lmoc_page_stiffen(lmoc_page *p, double rtol) {
  const lmoc_steps *s = &p->steps;
  lmoc_radau *r = &p->radau;
  const int64_t size = lmoc_page_room_of_radau(p);
  if (!size) return 0;
  if (!p->radau_memory && !(p->radau_memory = malloc((size_t)size * sizeof(double)))) return 0;
  *r = (lmoc_radau){.n = p->n, .owner = p, .rates = rates, .mark = mark, .go_back = go_back, .atol = p->atol, .rtol = rtol,
                    .end = s->end, .max_step = s->max_step, .step_size = s->step_size, .t = s->t};
  lmoc_radau_place(r, p->radau_memory);
  memcpy(r->x, s->x, p->n * sizeof(double));
  p->method = IMPLICIT;
  lmoc_radau_jump(r);
  return 1;
}

void lmoc_page_jump(lmoc_page *p) {
  lmoc_steps *s = &p->steps;
  memcpy(state_of(p), p->x, p->n * sizeof(double));
  if (p->method == IMPLICIT) {
    lmoc_radau_jump(&p->radau);
    return;
  }
  memcpy(p->begin, p->x, p->n * sizeof(double));
  s->before = s->t;
  s->length = 0;
  lmoc_page_rates(p, s->t);
  memcpy(s->f, p->answer, p->n * sizeof(double));
  if (p->branches) lmoc_page_mark(p);
}

/* ------------------------------------------------------------------ steps */

static int explicit_step(lmoc_page *p, double wanted) {
  lmoc_steps *s = &p->steps;
  lmoc_page_go_back(p);
  memcpy(p->begin, s->x, p->n * sizeof(double));
  s->times = &wanted;
  const int found = lmoc_dop853_walk(s);
  p->rejected += s->rejected;
  p->evaluations += s->evaluations;
  if (s->steps) p->dense = s->reached;
  return found;
}

int lmoc_page_step(lmoc_page *p, double wanted) {
  lmoc_steps *s = &p->steps;
  int found = 0;
  if (p->method == STANDING) {
    s->before = s->t;
    s->t = fmin(s->t + s->length, s->end);
  } else if (p->method == IMPLICIT) lmoc_radau_step(&p->radau);
  else found = explicit_step(p, wanted);
  memcpy(p->x, state_of(p), p->n * sizeof(double));
  return found;
}

double lmoc_page_told(const lmoc_page *p, int which) {
  const lmoc_steps *s = &p->steps;
  const lmoc_radau *r = &p->radau;
  const int implicit = p->method == IMPLICIT;
  const double all[] = {time_of(p), implicit ? r->before : s->before, implicit ? r->step_size : s->step_size,
                        (double)(p->rejected + (implicit ? r->rejected : 0)), (double)p->evaluations};
  return all[which];
}

/* The state within the last step of DOP853. */
static int within(lmoc_page *p, double time) {
  lmoc_steps *s = &p->steps;
  double *now = s->x, check = 0;
  s->x = p->begin;
  if (!p->dense) {
    lmoc_page_choose(p);
    const int64_t before = s->evaluations;
    lmoc_dop853_dense(s);
    p->evaluations += s->evaluations - before;
    p->dense = 1;
  }
  lmoc_dop853_within(s, (time - s->before) / s->length, p->answer);
  s->x = now;
  for (int64_t i = 0; i < p->n; i++) check += p->answer[i] * 0;
  return check == 0;
}

int lmoc_page_within(lmoc_page *p, double time) {
  if (time == time_of(p)) memcpy(p->answer, state_of(p), p->n * sizeof(double));
  else if (p->method == IMPLICIT) lmoc_radau_within(&p->radau, time, p->answer);
  else if (p->method == EXPLICIT) return within(p, time);
  return 1;
}

void lmoc_page_allowed(const lmoc_page *p, double *errors) {
  const double rtol = p->method == IMPLICIT ? p->radau.rtol : p->steps.rtol;
  for (int64_t i = 0; i < p->n; i++) errors[i] = rtol * fabs(p->x[i]) + p->atol[i];
}

/* Between the places at which a stiff method solves the equations, nothing controls the error of its way. */
void lmoc_page_defects(lmoc_page *p, double *defect) {
  const double from = lmoc_page_told(p, 1), by = (time_of(p) - from) / DEFECTS;
  double *kept = p->place, *slope = kept + p->n;
  const size_t size = (size_t)p->n * sizeof(double);
  memset(defect, 0, size);
  memcpy(kept, p->answer, size);
  for (int k = 1; k < DEFECTS && by > 0; k++) {
    if (!lmoc_page_within(p, from + (k - BESIDE) * by)) continue;
    memcpy(slope, p->answer, size);
    if (!lmoc_page_within(p, from + (k + BESIDE) * by)) continue;
    for (int64_t i = 0; i < p->n; i++) slope[i] = (p->answer[i] - slope[i]) / (2 * BESIDE * by);
    if (!lmoc_page_within(p, from + k * by)) continue;
    memcpy(p->x, p->answer, size);
    lmoc_page_rates(p, from + k * by);
    for (int64_t i = 0; i < p->n; i++) defect[i] = fmax(defect[i], fabs(p->answer[i] - slope[i]));
  }
  memcpy(p->x, kept, size);
  memcpy(p->answer, kept, size);
}

/* ------------------------------------------------------------------ roots */

int lmoc_page_roots(lmoc_page *p, double time) {
  const int64_t n = p->laws.run.k.laws.count;
  p->law_roots = n ? lmoc_page_watch_laws(p, time) : 0;
  for (int64_t k = 0; k < p->law_roots; k++) p->sides[k] = 1;
  lmoc_root_sides(&p->events.instant, p->sides + p->law_roots);
  return (int)(p->finder.count = p->law_roots + lmoc_roots(&p->events.instant));
}

double *lmoc_page_sides(lmoc_page *p) { return p->sides; }

double *lmoc_page_root_values(lmoc_page *p, double time) {
  if (p->law_roots) lmoc_page_law_values(p, time, p->values);
  if (p->finder.count > p->law_roots) lmoc_page_edge_values(p, time, p->values + p->law_roots);
  return p->values;
}

static int values_at(void *owner, int64_t count, const double *times, double *values) {
  lmoc_page *p = owner;
  for (int64_t k = 0; k < count; k++) {
    if (!lmoc_page_within(p, times[k])) return LMOC_ROOTS_HALTED;
    memcpy(p->x, p->answer, p->n * sizeof(double));
    memcpy(values + k * p->finder.count, lmoc_page_root_values(p, times[k]), (size_t)p->finder.count * sizeof(double));
  }
  return 0;
}

void lmoc_page_follow(lmoc_page *p, double time) {
  lmoc_finder *f = &p->finder;
  const double *values = lmoc_page_root_values(p, time);
  f->owner = p;
  f->values = values_at;
  for (int64_t k = 0; k < f->count; k++)
    f->signs[k] = p->sides[k] != 0 ? p->sides[k] : (values[k] > 0) - (values[k] < 0);
}

double lmoc_page_root(lmoc_page *p) {
  double time;
  lmoc_roots_of_step(&p->finder, p->method == IMPLICIT ? p->radau.before : p->steps.before, time_of(p));
  const int found = lmoc_next_root(&p->finder, &time);
  lmoc_followed(&p->events.instant);
  if (found == LMOC_NO_ROOT) return INFINITY;
  if (found == LMOC_ROOT && lmoc_page_within(p, time)) return time;
  return found == LMOC_ROOTS_NO_MEMORY ? NAN : -INFINITY;
}
