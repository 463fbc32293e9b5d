/* The choice of coordinates of a scene of a page: what `coordinate_watch.c` judges, and its memory. */

#include "page_scene.h"

#include <stdlib.h>

static int evaluate(void *call, double time, const double *x) { return lmoc_evaluate(call, time, x); }

/* Have nonlinear blocks go on from some solutions. */
static void begin_at(lmoc_page *p, const double *solutions) {
  const lmoc_step_watch *w = &p->coordinates.watch;
  lmoc_page_choose(p);
  for (int64_t i = 0; i < p->coordinates.judge.solved; i++) p->w[w->solved[i]] = solutions[i];
  lmoc_program_forget_pivots(&p->programs[p->right].program);
}

static int evaluate_near(void *owner, double time, const double *x, const double *solutions, double *slope, double *found) {
  lmoc_page *p = owner;
  const page_coordinates *v = &p->coordinates;
  begin_at(p, solutions);
  const int failed = lmoc_evaluate_near(&p->call, time, x);
  for (int64_t i = 0; i < p->n; i++) slope[i] = failed ? NAN : p->w[p->derivatives[i]];
  for (int64_t i = 0; i < v->judge.solved; i++) found[i] = p->w[v->watch.solved[i]];
  return 0;
}

static int make_room(lmoc_page *p) {
  page_coordinates *v = &p->coordinates;
  lmoc_coordinates *c = &v->judge;
  v->passage.n = p->n;
  v->passage.m = c->solved;
  const int64_t size = lmoc_coordinates_lay_out(c, 0);
  double *memory = calloc((size_t)(size + lmoc_passage_lay_out(&v->passage, 0)), sizeof(double));
  c->barred = calloc((size_t)c->watched + 1, 1);
  v->held = calloc((size_t)(3*c->columns), sizeof(int32_t));
  if (!memory || !c->barred || !v->held) return 0;
  lmoc_coordinates_lay_out(c, memory);
  lmoc_passage_lay_out(&v->passage, memory + size);
  return 1;
}

void lmoc_page_read_coordinates(lmoc_page *p, lmoc_bytes *b) {
  page_coordinates *v = &p->coordinates;
  lmoc_coordinates *c = &v->judge;
  int64_t count;
  if (!lmoc_read_integer(b)) return;
  v->program = lmoc_read_integer(b);
  c->rows = lmoc_read_integer(b);
  c->columns = lmoc_read_integer(b);
  c->ranked = lmoc_read_integer(b);
  c->row = lmoc_read_integers(b, &c->watched);
  c->units = lmoc_read_reals(b, &count);
  v->watch.entry = lmoc_read_integers(b, &v->watch.entry_count);
  v->watch.target = lmoc_read_integers(b, &count);
  v->watch.told = lmoc_read_integers(b, &c->told);
  v->watch.solved = lmoc_read_integers(b, &c->solved);
  v->passage.gauss = lmoc_read_reals(b, &count);
  const double *limits = lmoc_read_reals(b, &count);
  c->count = c->rows*c->columns;
  c->n = p->n;
  c->owner = &v->watch;
  c->ask = lmoc_step_watch_values;
  v->passage.owner = p;
  v->passage.near = evaluate_near;
  if (b->failed || count != (int64_t)(sizeof c->by / sizeof(double)) || !make_room(p)) {
    b->failed = 1;
    return;
  }
  memcpy(&c->by, limits, sizeof c->by);
}

/* Let the judge see the right-hand side. */
static lmoc_coordinates *judging(lmoc_page *p) {
  page_coordinates *v = &p->coordinates;
  if (p->call.tape != &p->programs[p->right].program.tape) lmoc_page_choose(p);
  v->watch.by = &v->judge;
  v->watch.call = &p->call;
  v->watch.evaluate = evaluate;
  v->watch.registers = v->watch.w = p->w;
  v->watch.tape = &p->programs[v->program].program.tape;
  return &v->judge;
}

double *lmoc_page_sizes(lmoc_page *p) { return p->coordinates.judge.size; }

static int told(lmoc_page *p, int found) {
  const lmoc_coordinates *c = &p->coordinates.judge;
  if (found == LMOC_SERVE) lmoc_mark(&p->call);
  return found == LMOC_SERVE ? 0 : c->lost_rank ? 3 : 1 + lmoc_coordinates_passed(c);
}

int lmoc_page_watch(lmoc_page *p, double time, int onward) {
  lmoc_coordinates *c = judging(p);
  c->equilibrated = c->lost_rank = 0;
  if (!onward) c->limit = 0;
  c->alert = c->by.alert;
  return told(p, lmoc_coordinates_begin(c, time, p->x));
}

int lmoc_page_judge(lmoc_page *p, double time) { return told(p, lmoc_coordinates_judge(judging(p), time, p->x)); }

int lmoc_page_stuck(lmoc_page *p) {
  lmoc_coordinates *c = &p->coordinates.judge;
  return lmoc_coordinates_stuck(c, c->by.dependent) ? 3 : lmoc_coordinates_better(c, p->coordinates.held) > 0;
}

int lmoc_page_determines(lmoc_page *p) {
  lmoc_coordinates *c = judging(p);
  return lmoc_coordinates_sign(c) != 0 && !lmoc_coordinates_vanish(c, c->accepted);
}

int lmoc_page_lost(const lmoc_page *p) { return (int)lmoc_coordinates_lost(&p->coordinates.judge); }

double lmoc_page_shorter(lmoc_page *p, int stalled, double span) {
  page_coordinates *v = &p->coordinates;
  return lmoc_coordinates_shorter(&v->judge, stalled, span, &v->until);
}

double lmoc_page_until(const lmoc_page *p) { return p->coordinates.until; }

int lmoc_page_better(lmoc_page *p) { return lmoc_coordinates_better(&p->coordinates.judge, p->coordinates.held); }

int32_t *lmoc_page_held(lmoc_page *p) { return p->coordinates.held; }

int lmoc_page_tolerate(lmoc_page *p) {
  lmoc_coordinates *c = &p->coordinates.judge;
  const int bad = c->limit > c->by.margin*c->by.tolerated;
  lmoc_coordinates_tolerate(c);
  return bad;
}

/* ------------------------------------------------------------------ passages */

void lmoc_page_stand(lmoc_page *p) {
  const double *x;
  double time;
  begin_at(p, lmoc_coordinates_accepted(&p->coordinates.judge, &time, &x));
  lmoc_page_seed(p);
}

static int margins(void *owner, int64_t count, const double *times, double *values) {
  lmoc_page *p = owner;
  page_coordinates *v = &p->coordinates;
  lmoc_passage *over = &v->passage;
  for (int64_t k = 0; k < count; k++) {
    lmoc_passage_at(over, times[k], over->x, over->sought);
    evaluate_near(p, times[k], over->x, over->sought, over->slopes, over->found);
    values[k] = lmoc_step_watch_margin(&v->watch, times[k]);
  }
  return 0;
}

double lmoc_page_pass(lmoc_page *p, double longest) {
  page_coordinates *v = &p->coordinates;
  lmoc_coordinates *c = judging(p);
  lmoc_passage *over = &v->passage;
  const double *x, *solutions = lmoc_coordinates_accepted(c, over->times, &x), width = 2*(c->singular - over->times[0]);
  double least = INFINITY;
  if (!(width > 0 && width < longest)) return NAN;
  memcpy(over->states, x, p->n * sizeof(double));
  memcpy(over->solutions, solutions, c->solved * sizeof(double));
  if (!lmoc_passage_find(over, width, p->atol)) return NAN;
  lmoc_lowest_about(margins, p, LMOC_PASSAGE_PLACES, over->times, &v->singular, &least);
  if (!(least < c->by.dependent)) v->singular = NAN;
  return over->times[LMOC_PASSAGE_PLACES - 1];
}

void lmoc_page_over(lmoc_page *p, double time) {
  lmoc_passage *over = &p->coordinates.passage;
  lmoc_passage_at(over, time, p->answer, over->sought);
  begin_at(p, over->sought);
  lmoc_page_seed(p);
}

int lmoc_page_beside(lmoc_page *p, double time) {
  page_coordinates *v = &p->coordinates;
  const double *times = v->passage.times;
  return lmoc_passage_beside(time, v->singular, times[LMOC_PASSAGE_PLACES - 1] - times[0], v->beside, v->beside + LMOC_BESIDE);
}

double *lmoc_page_weights(lmoc_page *p) { return p->coordinates.beside; }

/* ------------------------------------------------------------------ laws and events in other coordinates */

/* What laws and events stand at: into numbers, or back from them; how many they are. */
static int64_t carry(lmoc_page *p, double *at, int back) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  lmoc_law_run *s = &p->laws.run;
  const int64_t n = s->k.laws.count, zeros = e->zeros;
  int64_t total = 0;
#define EACH(value, count) \
  for (int64_t k = 0; k < (count); k++, total++) { \
    if (at && back) value = at[total]; \
    else if (at) at[total] = value; \
  }
  EACH(s->closed[k], n) EACH(s->implied[k], n) EACH(s->direction[k], n) EACH(s->push[k], n) EACH(s->touched[k], n)
  EACH(s->force[k], n) EACH(s->times->begun, n > 0) EACH(e->v[e->own[k]], e->discrete)
  EACH(e->zero[k], zeros) EACH(e->margin[k], zeros) EACH(e->largest[k], zeros)
  EACH(v->hops.home[k], zeros) EACH(v->hops.times[k], zeros * LMOC_CHATTER)
  EACH(v->next, 1) EACH(p->reached, 1) EACH(p->jumps.passed, 1)
#undef EACH
  return total;
}

int lmoc_page_carried_count(lmoc_page *p) { return (int)carry(p, 0, 0); }

double *lmoc_page_carried(lmoc_page *p) {
  free(p->coordinates.carried);
  p->coordinates.carried = calloc((size_t)carry(p, 0, 0), sizeof(double));
  if (p->coordinates.carried) carry(p, p->coordinates.carried, 0);
  return p->coordinates.carried;
}

int lmoc_page_adopt(lmoc_page *p, double time) {
  lmoc_law_run *s = &p->laws.run;
  const int64_t laws = s->k.laws.count;
  carry(p, p->coordinates.carried, 1);
  memcpy(p->answer, p->x, (size_t)p->n * sizeof(double));
  p->switched = 1;
  if (laws) lmoc_page_hold(p);
  p->events.instant.literal = 0;
  if (p->events.instant.owner) lmoc_take(&p->events.instant, time, p->answer);
  if (!laws) return 0;
  int found = lmoc_law_renew(s);
  if (!found) found = lmoc_law_go_on(s, time, p->answer, 0);
  lmoc_page_hold(p);
  return found;
}
