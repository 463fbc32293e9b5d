/* The choice of coordinates of a scene of a page: what `coordinate_watch.c` judges, and its memory. */

#include "page_scene.h"

#include <stdlib.h>

static int evaluate(void *call, double time, const double *x) { return lmoc_evaluate(call, time, x); }

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
  v->watch.entry = lmoc_read_integers(b, &v->watch.entry_count);
  v->watch.target = lmoc_read_integers(b, &count);
  v->watch.told = lmoc_read_integers(b, &c->told);
  const double *limits = lmoc_read_reals(b, &count);
  c->count = c->rows*c->columns;
  c->n = p->n;
  c->owner = &v->watch;
  c->ask = lmoc_step_watch_values;
  const int64_t size = lmoc_coordinates_lay_out(c, 0);
  double *memory = b->failed ? 0 : calloc((size_t)size, sizeof(double));
  uint8_t *barred = calloc((size_t)c->watched + 1, 1);
  v->held = calloc((size_t)(3*c->columns), sizeof(int32_t));
  if (!memory || !barred || !v->held || count != (int64_t)(sizeof c->by / sizeof(double))) {
    b->failed = 1;
    return;
  }
  memcpy(&c->by, limits, sizeof c->by);
  c->barred = barred;
  lmoc_coordinates_lay_out(c, memory);
}

/* Let the judge see the right-hand side where it has been evaluated last. */
static lmoc_coordinates *judging(lmoc_page *p) {
  page_coordinates *v = &p->coordinates;
  const lmoc_tape *right = &p->programs[p->right].program.tape;
  if (p->call.tape != right) lmoc_page_evaluate(p, (int)p->right, p->call.time);
  v->watch.by = &v->judge;
  v->watch.call = &p->call;
  v->watch.evaluate = evaluate;
  v->watch.registers = v->watch.w = p->w;
  v->watch.tape = &p->programs[v->program].program.tape;
  return &v->judge;
}

double *lmoc_page_sizes(lmoc_page *p) { return p->coordinates.judge.size; }

void lmoc_page_watch(lmoc_page *p, double time) {
  lmoc_coordinates *c = judging(p);
  c->limit = c->equilibrated = 0;
  c->alert = c->by.alert;
  lmoc_coordinates_begin(c, time, p->x);
  lmoc_mark(&p->call);
}

int lmoc_page_judge(lmoc_page *p, double time) {
  lmoc_coordinates *c = judging(p);
  const int found = lmoc_coordinates_judge(c, time, p->x);
  if (found == LMOC_SERVE) lmoc_mark(&p->call);
  return found == LMOC_SERVE ? 0 : c->lost_rank ? 3 : 1 + lmoc_coordinates_passed(c);
}

double lmoc_page_shorter(lmoc_page *p, int stalled, double span) {
  page_coordinates *v = &p->coordinates;
  return lmoc_coordinates_shorter(&v->judge, stalled, span, &v->until);
}

double lmoc_page_until(const lmoc_page *p) { return p->coordinates.until; }

int lmoc_page_better(lmoc_page *p, int stuck) {
  lmoc_coordinates *c = &p->coordinates.judge;
  if (stuck) {
    c->last = c->accepted;
    c->lost_rank = 0;
  }
  return lmoc_coordinates_better(c, p->coordinates.held);
}

int32_t *lmoc_page_held(lmoc_page *p) { return p->coordinates.held; }

void lmoc_page_tolerate(lmoc_page *p) { lmoc_coordinates_tolerate(&p->coordinates.judge); }
