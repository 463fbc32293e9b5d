/* A table of inputs, or a formula of time with kinks, divides a run into pieces, often so short that each is a single step.
   A piece is made by the rules of `steps/automatic.py` for one that takes few steps: with the first method and its
   tolerance, so that the steps are those of pieces that are made one by one. */

#include "pieces.h"

/* A piece from `p->begin` to `p->end`, and the output in it: whether it has been made. */
typedef int (*make)(void *method, lmoc_pieces *p, const double *times, double *out);

/* Output times up to the end of the next piece. */
static int64_t ahead(const lmoc_pieces *p) {
  int64_t count = 0;
  while (p->reached + count < p->outputs && p->times[p->reached + count] <= p->end[p->passed]) count++;
  return count;
}

/* Keep where a piece begins, and what blocks go on from there; or go back to it. */
static void keep(const lmoc_call *c, const double *x, double *kept) {
  memcpy(kept, x, c->n * sizeof(double));
  memcpy(kept + c->n, c->solution, 3*c->remembered * sizeof(double));
  memcpy(kept + c->n + 3*c->remembered, c->x, 3*c->given * sizeof(double));
}

static void go_back(lmoc_call *c, double *x, const double *kept) {
  memcpy(x, kept, c->n * sizeof(double));
  memcpy(c->solution, kept + c->n, 3*c->remembered * sizeof(double));
  memcpy(c->x, kept + c->n + 3*c->remembered, 3*c->given * sizeof(double));
  *c->last = 0;
}

/* The pieces in order; one that cannot be made leaves no trace but what it has cost. */
static void pass(lmoc_call *c, double *x, lmoc_pieces *p, make piece, void *method) {
  p->passed = p->steps = p->rejected = p->evaluations = p->reached = p->stuck = 0;
  for (; p->passed < p->count && p->steps + p->rejected < p->all; p->passed++) {
    const lmoc_call before = *c;
    const int64_t outputs = ahead(p);
    p->stuck = outputs > p->room - p->reached;
    if (p->stuck) return;
    keep(c, x, p->kept);
    if (!piece(method, p, p->times + p->reached, p->out + p->reached*c->n)) {
      *c = before;
      go_back(c, x, p->kept);
      p->stuck = 1;
      return;
    }
    p->reached += outputs;
  }
}

/* Whether a piece may go on: after the first steps as far as so many in all are expected, as in `steps/loop.py`. */
static int goes_on(const lmoc_pieces *p, int64_t made, double time) {
  const double begin = p->begin[p->passed], end = p->end[p->passed];
  return (double)made*(end - time) < (double)p->overrun*(time - begin);
}

static int with_dop853(void *method, lmoc_pieces *p, const double *times, double *out) {
  lmoc_steps *s = method;
  const int64_t k = p->passed, n = s->call->n;
  int64_t made = 0, reached = 0;
  int found, last = 0;
  s->t = p->begin[k];
  s->end = p->end[k];
  s->max_step = p->longest[k];
  found = lmoc_dop853_begin(s, INFINITY) ? 0 : LMOC_LOST;
  p->evaluations += s->evaluations;
  for (s->most = p->most; !found && s->t < s->end && !last; s->most = p->overrun) {
    last = made > 0;
    if (last && !goes_on(p, made, s->t)) break;
    s->times = times + reached;
    s->out = out + reached*n;
    s->outputs = s->room = p->outputs - p->reached - reached;
    found = lmoc_dop853_walk(s);
    made += s->steps;
    reached += s->reached;
    p->evaluations += s->evaluations;
    p->steps += s->steps;
    p->rejected += s->rejected;
  }
  if (found || s->t < s->end) return 0;
  p->before = s->before;
  p->time = s->t;
  return 1;
}

void lmoc_dop853_pass(lmoc_steps *s, lmoc_pieces *p) {
  p->before = s->before;
  p->time = s->t;
  pass(s->call, s->x, p, with_dop853, s);
}

typedef struct {
  const lmoc_taylor *taylor;
  lmoc_walk *walk;
} along;

static int along_series(void *method, lmoc_pieces *p, const double *times, double *out) {
  const along *a = method;
  lmoc_walk *s = a->walk;
  const int64_t k = p->passed, n = a->taylor->call->n;
  int64_t made = 0, reached = 0;
  int found = 0, last = 0;
  s->time[0] = s->before[0] = p->begin[k];
  s->end = p->end[k];
  s->longest = p->longest[k];
  s->begins[0] = 1;
  for (int64_t i = 0; i < n; i++) s->next[i*LMOC_LENGTH] = s->x[i];
  p->evaluations++;
  for (s->most[0] = p->most; !found && s->time[0] < s->end && !last; s->most[0] = p->overrun) {
    last = made > 0;
    if (last && !goes_on(p, made, s->time[0])) break;
    s->times[0] = times + reached;
    s->out[0] = out + reached*n;
    s->outputs[0] = s->room[0] = p->outputs - p->reached - reached;
    found = lmoc_taylor_walk(a->taylor, s);
    made += s->steps[0];
    reached += s->reached[0];
    p->steps += s->steps[0];
    p->rejected += s->tries[0] - s->steps[0];
    p->evaluations += s->tries[0];
  }
  if (found || s->time[0] < s->end) return 0;
  p->before = s->before[0];
  p->time = s->time[0];
  return 1;
}

void lmoc_taylor_pass(const lmoc_taylor *y, lmoc_walk *s, lmoc_pieces *p) {
  along a = {y, s};
  p->before = s->before[0];
  p->time = s->time[0];
  pass(y->call, s->x, p, along_series, &a);
}
