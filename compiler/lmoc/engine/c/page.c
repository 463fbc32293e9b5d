/* A scene of a page. */

#include "page_scene.h"

#include <stdlib.h>

enum { RESERVE = 1 << 23 }; /* bytes for factors of matrices that fill in later, and for samples of functions */

/* ------------------------------------------------------------------ signals */

void lmoc_page_sample(lmoc_page *p, double time) {
  lmoc_tables_fill(&p->tables, time, p->w);
}

static int run_with_signals(double time, double *w, const lmoc_tape *t) {
  lmoc_page_sample(((const scene_program *)t)->page, time);
  return lmoc_tape_run(time, w, t);
}

/* ------------------------------------------------------------------ reading */

uint8_t *lmoc_page_room(int size) { return malloc((size_t)size + 1); }

static void read_tables(lmoc_page *p, lmoc_bytes *b) {
  int64_t count;
  p->tables.count = lmoc_read_integer(b);
  p->tables.table = calloc((size_t)p->tables.count + 1, sizeof(lmoc_table));
  for (int64_t k = 0; p->tables.table && !b->failed && k < p->tables.count; k++) {
    lmoc_table *c = p->tables.table + k;
    c->place = lmoc_read_integer(b);
    c->order = lmoc_read_integer(b);
    c->knots = lmoc_read_reals(b, &c->knot_count);
    c->coefficients = lmoc_read_reals(b, &count);
    c->degrees = c->knot_count > 1 ? count / (c->knot_count - 1) : 0;
    c->low = lmoc_read_reals(b, &count);
    c->high = lmoc_read_reals(b, &count);
    c->ends = lmoc_read_reals(b, &count);
  }
  if (!p->tables.table) b->failed = 1;
}

static void read_programs(lmoc_page *p, lmoc_bytes *b) {
  p->program_count = lmoc_read_integer(b);
  p->programs = calloc((size_t)p->program_count + 1, sizeof(scene_program));
  for (int64_t k = 0; p->programs && !b->failed && k < p->program_count; k++) {
    p->programs[k].page = p;
    lmoc_read_program(b, &p->programs[k].program);
    p->programs[k].program.tape.run = run_with_signals;
    if (p->programs[k].program.size > p->size) p->size = p->programs[k].program.size;
  }
  if (!p->programs) b->failed = 1;
}

static void read_method(lmoc_page *p, lmoc_bytes *b) {
  int64_t count;
  p->steps.weights = lmoc_read_reals(b, &count);
  p->steps.nodes = lmoc_read_reals(b, &count);
  p->steps.dense = lmoc_read_reals(b, &count);
  p->steps.omitted = lmoc_read_reals(b, &count);
  const double *rules = lmoc_read_reals(b, &count);
  if (rules && count == (int64_t)(sizeof p->rules / sizeof(double))) memcpy(&p->rules, rules, sizeof p->rules);
  else b->failed = 1;
}

/* A step is taken as it is; the host judges it. */
static int look(void *own, double time, const double *x, int first) {
  (void)own, (void)time, (void)x, (void)first;
  return 0;
}

/* Where the choice of coordinates is judged, the judge marks what serves. */
static void keep(void *own) {
  lmoc_page *p = own;
  if (!p->coordinates.held) lmoc_mark(&p->call);
}

/* Memory for what the scene needs beside its tables. */
static int make_room(lmoc_page *p) {
  const int64_t n = p->n, m = p->unknown_count;
  const int64_t functions = 2*p->laws.run.k.laws.count + lmoc_roots(&p->events.instant);
  const int64_t steps = p->jumps.count ? p->size : 0;
  const int64_t most = p->size + steps + 40*n + 4*m + 5*functions + 8;
  double *at = p->w = calloc((size_t)most, sizeof(double));
  if (!at) return 0;
  at += p->size;
#define TAKE(name, count) (p->name = at, at += (count))
  TAKE(x, n), TAKE(answer, n), TAKE(atol, n), TAKE(f, n), TAKE(begin, n), TAKE(steps.x_new, n), TAKE(steps.k, 16*n);
  TAKE(steps.last, n), TAKE(steps.terms, 7*n), TAKE(steps.x, n), TAKE(call.x, 3*n), TAKE(call.solution, 3*m);
  TAKE(sides, functions), TAKE(values, functions), TAKE(now, functions), TAKE(finder.signs, functions), TAKE(place, 2*n);
  TAKE(jumps.w, steps);
#undef TAKE
  p->finder.which = (uint8_t *)at;
  return 1;
}

lmoc_page *lmoc_page_new(const uint8_t *bytes, int size) {
  lmoc_bytes b = {bytes, bytes + size, 0};
  lmoc_page *p = calloc(1, sizeof *p);
  int64_t count;
  if (!p) return 0;
  p->size = lmoc_read_integer(&b);
  p->branches = lmoc_read_integer(&b);
  p->right = lmoc_read_integer(&b);
  p->states = lmoc_read_integers(&b, &p->n);
  p->derivatives = lmoc_read_integers(&b, &count);
  p->unknowns = lmoc_read_integers(&b, &p->unknown_count);
  read_tables(p, &b);
  read_method(p, &b);
  read_programs(p, &b);
  lmoc_page_read_events(p, &b);
  lmoc_page_read_laws(p, &b);
  lmoc_page_read_coordinates(p, &b);
  lmoc_page_read_jumps(p, &b);
  if (b.failed || p->right >= p->program_count || !make_room(p)) return 0;
  if (!lmoc_page_reserve(RESERVE + 16 * (int)lmoc_page_room_of_radau(p))) return 0; /* in pieces of powers of two */
  for (int64_t k = 0; k < p->program_count; k++) lmoc_put_constants(&p->programs[k].program, p->w);
  p->events.instant.v = p->events.instant.line = p->w;
  p->call.w = p->w;
  p->call.n = p->call.given = p->n;
  p->call.first_state = -1;
  p->call.states = p->states;
  p->call.derivatives = p->derivatives;
  p->call.unknowns = p->unknowns;
  p->call.last = &p->last;
  p->hook = (lmoc_step_hook){p, look, 0, keep, 0};
  return p;
}

double *lmoc_page_registers(lmoc_page *p) { return p->w; }
double *lmoc_page_state(lmoc_page *p) { return p->x; }
double *lmoc_page_answer(lmoc_page *p) { return p->answer; }
double *lmoc_page_tolerances(lmoc_page *p) { return p->atol; }

/* ------------------------------------------------------------------ values */

int lmoc_page_run(lmoc_page *p, int program, double time) {
  return lmoc_tape_run(time, p->w, &p->programs[program].program.tape);
}

/* Let a program be the one that is evaluated; its registers may have been changed from outside. */
static void choose(lmoc_page *p, int64_t program) {
  const lmoc_program *g = &p->programs[program].program;
  p->call.tape = &g->tape;
  p->call.remembered = g->remembers ? p->unknown_count : 0;
  p->last = 0;
}

/* Where other equations hold than at the last solution, theirs may be elsewhere. What follows from unknowns without a
   solution has no value. */
int lmoc_page_evaluate(lmoc_page *p, int program, double time) {
  lmoc_call *c = &p->call;
  choose(p, program);
  int status = lmoc_evaluate(c, time, p->x);
  if (!c->remembered) return status;
  if (status && p->switched && c->solved) {
    for (int64_t k = 0; k < c->remembered; k++) p->w[c->unknowns[k]] = c->solution[k];
    c->solved = c->marked = 0;
    status = lmoc_evaluate(c, time, p->x);
  }
  if (!(status & LMOC_FAILED)) {
    p->switched = 0;
    return status;
  }
  for (int64_t k = 0; k < c->remembered; k++) p->w[c->unknowns[k]] = NAN;
  c->tape->run(time, p->w, c->tape);
  return status;
}

void lmoc_page_rates(lmoc_page *p, double time) {
  const int failed = lmoc_page_evaluate(p, (int)p->right, time) & LMOC_FAILED;
  for (int64_t i = 0; i < p->n; i++) p->answer[i] = failed ? NAN : p->w[p->derivatives[i]];
  p->evaluations++;
}

void lmoc_page_forget(lmoc_page *p) {
  for (int64_t k = 0; k < p->program_count; k++) lmoc_program_forget(&p->programs[k].program);
}

void lmoc_page_seed(lmoc_page *p) { p->call.solved = p->call.marked = p->switched = 0; }

void lmoc_page_choose(lmoc_page *p) { choose(p, p->right); }

void lmoc_page_mark(lmoc_page *p) {
  lmoc_page_choose(p);
  lmoc_mark(&p->call);
}

void lmoc_page_go_back(lmoc_page *p) {
  lmoc_page_choose(p);
  if (p->call.marked) lmoc_go_back(&p->call);
}

/* ------------------------------------------------------------------ least squares */

double *lmoc_page_matrix(lmoc_page *p, int order) {
  const size_t n = (size_t)order;
  free(p->matrix);
  p->order = order;
  return p->matrix = calloc(2*n*n + 3*n, sizeof(double));
}

double *lmoc_page_least_squares(lmoc_page *p, double share) {
  const int64_t n = p->order;
  double *u = p->matrix, *right = u + n*n, *v = right + n, *values = v + n*n, *found = values + n;
  lmoc_singular_values(n, n, u, v, values);
  lmoc_least_squares(n, u, v, values, share, right, found);
  return found;
}
