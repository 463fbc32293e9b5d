/* The laws of a scene of a page: `law_run.c` on its programs. */

#include "page_scene.h"

#include <stdlib.h>

/* ------------------------------------------------------------------ the mode in the registers */

/* That of the run, or with all laws open. */
static void put(lmoc_page *p, int open) {
  const page_laws *l = &p->laws;
  const int32_t *registers = l->free.inputs;
  lmoc_law_inputs(&l->run, l->inputs);
  for (int64_t i = 0; i < 3 * l->run.k.laws.count; i++) if (registers[i] >= 0) p->w[registers[i]] = open ? 0 : l->inputs[i];
  for (int64_t j = 0; j < p->n; j++) if (l->held[j] >= 0) p->w[l->held[j]] = open ? 0 : l->run.held[j];
  p->switched = 1;
}

void lmoc_page_open(lmoc_page *p) { put(p, 1); }
void lmoc_page_hold(lmoc_page *p) { put(p, 0); }

/* Quantities with all laws open; nonlinear blocks near their last solution. */
static int at(void *owner, double time, const double *x, const lmoc_settled *mode, double *values) {
  lmoc_page *p = owner;
  lmoc_page_open(p);
  if (p->unknown_count) {
    memmove(p->x, x, p->n * sizeof(double));
    lmoc_page_evaluate(p, (int)p->laws.by_force, time);
  }
  return lmoc_free_at(&p->laws.free, time, x, mode, values);
}

/* ------------------------------------------------------------------ reading */

static lmoc_flag *read_flags(lmoc_bytes *b) {
  int64_t count;
  int32_t *found = lmoc_read_integers(b, &count);
  lmoc_flag *flags = calloc((size_t)count + 1, 1);
  if (!flags) b->failed = 1;
  for (int64_t k = 0; found && flags && k < count; k++) flags[k] = found[k] != 0;
  free(found);
  return flags;
}

static int64_t *read_numbers(lmoc_bytes *b, int64_t *count) {
  int32_t *found = lmoc_read_integers(b, count);
  int64_t *numbers = calloc((size_t)*count + 1, sizeof(int64_t));
  if (!numbers) b->failed = 1;
  for (int64_t k = 0; found && numbers && k < *count; k++) numbers[k] = found[k];
  free(found);
  return numbers;
}

static void read_derivatives(lmoc_page *p, lmoc_bytes *b, int which, int64_t program) {
  lmoc_free_dynamics *f = &p->laws.free;
  int64_t count;
  f->place[which] = lmoc_read_integers(b, &f->count[which]);
  f->entry[which] = lmoc_read_integers(b, &count);
  if (count != f->count[which] || program >= p->program_count) b->failed = 1;
  else f->tape[which] = &p->programs[program].program.tape;
}

void lmoc_page_read_laws(lmoc_page *p, lmoc_bytes *b) {
  page_laws *l = &p->laws;
  lmoc_law_run *s = &l->run;
  lmoc_laws *laws = &s->k.laws;
  int64_t count;
  if (!lmoc_read_integer(b)) return;
  l->by_force = lmoc_read_integer(b);
  const int64_t by_state = lmoc_read_integer(b);
  l->roots = lmoc_read_integer(b);
  l->free.stored = lmoc_read_integer(b);
  s->work = lmoc_read_integer(b);
  s->heat = lmoc_read_integer(b);
  laws->degree = read_numbers(b, &laws->count);
  laws->normal = read_numbers(b, &count);
  s->k.unilateral = read_flags(b);
  laws->complementary = read_flags(b);
  laws->dry = read_flags(b);
  laws->contact = read_flags(b);
  s->linear = read_flags(b);
  s->curved = read_flags(b);
  s->position = read_flags(b);
  s->k.ledger = read_flags(b);
  l->limited = read_flags(b);
  const int32_t **tables[] = {&l->restitution_of, &l->free.quantity, &l->read, &l->free.inputs, &l->held};
  for (size_t k = 0; k < sizeof tables / sizeof *tables; k++) *tables[k] = lmoc_read_integers(b, &count);
  read_derivatives(p, b, LMOC_BY_FORCE, l->by_force);
  read_derivatives(p, b, LMOC_BY_STATE, by_state);
  if (b->failed || l->roots >= p->program_count) {
    b->failed = 1;
    return;
  }
  const int64_t n = laws->count, m = s->k.states = p->n, own = 16*n + 2*m;
  double *memory = calloc((size_t)(own + lmoc_law_place(s, 0) + 1), sizeof(double));
  l->which = calloc((size_t)(2*n + 1), 1);
  if (!memory || !l->which) {
    b->failed = 1;
    return;
  }
  lmoc_law_place(s, memory + own);
#define TAKE(name, count) (name = place, place += (count))
  double *place = memory;
  TAKE(l->inputs, 3*n), TAKE(l->restitution, n), TAKE(l->errors, m), TAKE(l->unresolved, m), TAKE(l->known, 6*n);
  TAKE(l->values, 4*n), TAKE(l->limits, n), TAKE(s->noise, n);
#undef TAKE
  for (int64_t k = 0; k < 6*n; k++) l->known[k] = NAN;
  s->k.restitution = l->restitution;
  s->k.errors = l->errors;
  s->k.unresolved = l->unresolved;
  s->k.owner = p;
  s->k.at = at;
  s->limits = l->limits;
  l->free.laws = n;
  l->free.states = m;
  l->free.state = p->states;
  l->free.known = l->known;
}

/* ------------------------------------------------------------------ the host */

void lmoc_page_begin_laws(lmoc_page *p, double moment) {
  page_laws *l = &p->laws;
  const int64_t n = l->run.k.laws.count;
  l->free.w[0] = l->free.w[1] = p->w;
  l->run.moment = moment;
  p->reached = -INFINITY;
  for (int64_t k = 0; k < n; k++) {
    const int32_t own = l->restitution_of[k], stick = l->free.quantity[4*n + k];
    l->restitution[k] = own < 0 ? 0 : p->w[own];
    l->limits[k] = l->limited[k] && stick >= 0 ? p->w[stick] : NAN;
  }
  memset(l->errors, 0, 2 * p->n * sizeof(double));
  lmoc_law_open(&l->run);
  lmoc_page_open(p);
}

/* What an integrator allows itself in a step, and what it tells apart by no more. */
double *lmoc_page_errors(lmoc_page *p) { return p->laws.errors; }

/* What comes of a change of the state, which becomes the answer. */
static int answered(lmoc_page *p, int found) {
  lmoc_page_hold(p);
  return found;
}

int lmoc_page_start_laws(lmoc_page *p, double time) {
  lmoc_law_run *s = &p->laws.run;
  memcpy(p->answer, p->x, p->n * sizeof(double));
  const int failed = lmoc_law_renew(s);
  return answered(p, failed ? failed : lmoc_law_start(s, time, p->answer));
}

int lmoc_page_laws_at(lmoc_page *p, double time, const uint8_t *roots, int jumped) {
  page_laws *l = &p->laws;
  const lmoc_law_run *s = &l->run;
  const int64_t n = s->k.laws.count;
  int64_t second = n;
  for (int64_t k = 0; k < n; k++) {
    l->which[k] = roots && roots[k];
    l->which[n + k] = roots && s->closed[k] && !s->k.laws.complementary[k] && roots[second++];
  }
  memcpy(p->answer, p->x, p->n * sizeof(double));
  return answered(p, lmoc_law_happen(&l->run, time, p->answer, l->which, jumped));
}

int lmoc_page_laws_happen(lmoc_page *p, double time) { return lmoc_page_laws_at(p, time, 0, 0); }

/* ------------------------------------------------------------------ what stays closed */

int lmoc_page_laws_drift(const lmoc_page *p) { return lmoc_law_drifts(&p->laws.run); }

int lmoc_page_keep(lmoc_page *p, double time, double share) {
  memcpy(p->answer, p->x, p->n * sizeof(double));
  return answered(p, lmoc_law_keep(&p->laws.run, time, share, p->answer));
}

/* Motions, rates, forces and sticking limits for the state. */
static const double *reading(lmoc_page *p, double time) {
  page_laws *l = &p->laws;
  const int lost = lmoc_page_evaluate(p, (int)l->roots, time) & LMOC_FAILED;
  for (int64_t k = 0; k < 4 * l->run.k.laws.count; k++)
    l->values[k] = lost || l->read[k] < 0 ? NAN : p->w[l->read[k]];
  return l->values;
}

int lmoc_page_watch_laws(lmoc_page *p, double time) {
  const lmoc_law_run *s = &p->laws.run;
  int64_t count = s->k.laws.count;
  lmoc_law_watch(&p->laws.run, reading(p, time));
  for (int64_t k = 0; k < s->k.laws.count; k++) count += s->closed[k] && !s->k.laws.complementary[k];
  return (int)count;
}

void lmoc_page_law_values(lmoc_page *p, double time, double *out) {
  lmoc_law_values(&p->laws.run, 1, reading(p, time), out);
}

double lmoc_page_law(const lmoc_page *p, int k, int which) {
  const lmoc_law_run *s = &p->laws.run;
  const double all[] = {s->closed[k], s->implied[k], (double)s->direction[k], s->push[k], (double)s->kind[k], s->when[k],
                        s->impulse[k], s->lost[k], s->was[k], s->is[k], s->laws[k], s->spare.gap[k], (double)s->law,
                        s->k.laws.complementary[k]};
  return all[which];
}
