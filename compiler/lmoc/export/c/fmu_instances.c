/* Instances of an FMU: their memory, how they begin, and their states saved and restored. */

#include "discrete.h"
#include "fmu_laws.h"
#include "fmu_loops.h"

#include <stdlib.h>

static const fmu_tape *tape_of(const fmu_model *m, int k) {
  const fmu_events *e = &m->events;
  const fmu_tape *all[] = {&m->parametric, &m->right, &m->observe, &m->slopes, &e->look, &e->assign, &e->line, &e->begin,
                           &m->laws.by_force, &m->laws.by_state, &m->jumps.rates,
                           &m->loops.stage[0].tape, &m->loops.stage[1].tape};
  return all[k];
}

static int make_tape(fmu *f, int k, int32_t **pivots) {
  const fmu_tape *t = tape_of(f->model, k);
  f->blocks[k] = calloc((size_t)t->block_count + 1, sizeof(lmoc_block));
  if (!f->blocks[k]) return 0;
  for (int64_t i = 0; i < t->block_count; i++) {
    lmoc_block *b = f->blocks[k] + i;
    *b = t->blocks[i];
    b->pivots = *pivots;
    *pivots += t->pivots[i];
    if (b->start && !(b->lu = lmoc_lu_new(b->size, b->start, b->rows))) return 0;
  }
  f->tape[k] = (lmoc_tape){lmoc_tape_run, t->code, t->index, f->blocks[k], &lmoc_block_functions, t->time};
  return 1;
}

/* Places in one piece of memory: all that a saved state has to hold, but for integers. */
static int64_t place_memory(fmu *f) {
  const fmu_model *m = f->model;
  const fmu_events *e = &m->events;
  const lmoc_instant *i = &e->tables;
  const int64_t laws = m->laws.laws.count;
  double *at = f->memory;
  int64_t total = 0;
#define TAKE(name, count) (f->name = at ? at + total : 0, total += (count))
  TAKE(p, m->parameters);
  TAKE(x, m->states);
  TAKE(u, m->inputs);
  for (int k = 0; k < TAPES; k++) TAKE(w[k], tape_of(m, k)->size);
  TAKE(solution, 3*m->unknowns);
  TAKE(solution_x, 3*m->states);
  TAKE(sign, m->unknowns);
  TAKE(e.zero, i->zeros);
  TAKE(e.margin, i->zeros);
  TAKE(e.largest, i->zeros);
  TAKE(e.high, i->zeros);
  TAKE(e.crossed, i->zeros);
  TAKE(e.early, i->relations);
  TAKE(hops.times, i->zeros * LMOC_CHATTER);
  TAKE(hops.home, i->zeros);
  TAKE(warned, e->watched);
  TAKE(known, 6*laws);
  TAKE(restitution, laws);
  TAKE(errors, m->states);
  TAKE(unresolved, m->states);
  TAKE(foresight, fmu_hop_room(m, fmu_roots(f)));
  fmu_law_ask(f);
  total += lmoc_law_place(&f->laws, at ? at + total : 0);
  total += fmu_loops_place(f, at ? at + total : 0);
  f->doubles = total;
  TAKE(work, 32*m->states + 4);
  TAKE(branch, 3*m->unknowns);
  TAKE(noise, 3*i->zeros + m->states);
  TAKE(e.history, i->discrete * LMOC_HISTORY);
  TAKE(e.supposed, i->relations);
  TAKE(e.changed, i->discrete);
  TAKE(e.flipped, i->discrete);
  TAKE(moved, 5*m->states);
  TAKE(root, 4*fmu_roots(f));
  f->finder.which = (uint8_t *)(at ? f->root + 3*fmu_roots(f) : 0);
  TAKE(which, i->zeros);
  TAKE(events.turn, i->zeros);
  TAKE(events.at, i->zeros);
  TAKE(events.begun, m->states);
  TAKE(events.held, i->discrete);
  TAKE(before, m->states);
  TAKE(hops.work, 4*m->states + 9*i->zeros);
  TAKE(law_read, 4*laws);
  TAKE(law_before, m->states);
  TAKE(law_moved, m->states);
  TAKE(ahead, fmu_hop_room(m, fmu_roots(f)));
  TAKE(step, fmu_jump_room(m));
  TAKE(at_event, i->discrete);
  total += fmu_loops_scratch(f, at ? at + total : 0);
  double *scratch;
  scratch = at ? at + total : 0, total += i->told;
  f->e.found = (int64_t *)scratch;
  f->law_which = (lmoc_flag *)(at ? at + total : 0), total += (2*laws + 7) / 8;
  f->e.moved = f->moved;
  f->events.which = f->which;
  f->e.v = f->w[ASSIGN];
  f->e.line = f->w[LINES];
  f->e.assign = f->tape + ASSIGN;
  f->e.lines = f->tape + LINES;
#undef TAKE
  return total;
}

void fmu_forget(fmu *f) {
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) {
      lmoc_block *b = f->blocks[k] + i;
      b->ready = 0;
      if (b->lu) lmoc_lu_forget(b->lu);
    }
}

void fmu_guess(fmu *f) {
  const fmu_model *m = f->model;
  const int tapes[] = {RIGHT, OBSERVE, LOOK, BY_FORCE, BY_STATE};
  for (size_t k = 0; k < (m->laws.laws.count ? 5 : 3); k++)
    for (int64_t i = 0; i < m->unknowns; i++) f->w[tapes[k]][m->unknown[i]] = m->guess[i];
}

void fmu_reset(fmu *f) {
  const fmu_model *m = f->model;
  const int co_simulation = f->now.co_simulation;
  f->now = (fmu_scalars){.time = m->start_time, .begin = m->start_time, .rtol = m->tolerance, .phase = FMU_FRESH,
                         .co_simulation = co_simulation, .stale = 1, .next = INFINITY, .foreseen = INFINITY, .turned = -INFINITY};
  memset(f->memory, 0, f->doubles * sizeof(double));
  memcpy(f->p, m->parameter_start, m->parameters * sizeof(double));
  memcpy(f->x, m->start, m->states * sizeof(double));
  memcpy(f->u, m->input_start, m->inputs * sizeof(double));
  for (int k = 0; k < TAPES; k++) {
    const fmu_tape *t = tape_of(m, k);
    for (int64_t i = 0; i < t->constant_count; i++) f->w[k][t->places[i]] = t->values[i];
  }
  memcpy(f->w[PARAMETRIC], m->known, m->parametric.time * sizeof(double));
  for (int k = LOOK; k <= BEGIN; k++) f->w[k][m->events.absent] = NAN;
  lmoc_law_open(&f->laws);
  for (int64_t i = 0; i < f->e.zeros * LMOC_CHATTER; i++) f->hops.times[i] = -INFINITY;
  fmu_guess(f);
  fmu_forget(f);
  f->last = 0;
  f->call.solved = f->call.marked = 0;
}

static int64_t remembered(const fmu_tape *t) {
  int64_t count = 0;
  for (int64_t i = 0; i < t->block_count; i++)
    if (t->blocks[i].work) count += t->blocks[i].instances * t->blocks[i].size;
  return count;
}

/* Numbers that say in which order sparse factors are made. */
static int64_t order_count(const fmu *f) {
  int64_t count = 0;
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) {
      const lmoc_lu *lu = f->blocks[k][i].lu;
      if (lu) count += 1 + lu->start[lu->n];
    }
  return count;
}

fmu *fmu_new(const fmu_model *model, int co_simulation, void *owner, fmu_tell tell, fmu_tell warn, fmu_tell note) {
  fmu *f = calloc(1, sizeof *f);
  if (!f) return 0;
  f->model = model;
  f->patience = INT64_MAX;
  f->e = model->events.tables;
  fmu_ask(f);
  f->owner = owner;
  f->tell = tell;
  f->warn = warn;
  f->note = note;
  f->now.co_simulation = co_simulation;
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(model, k)->block_count; i++) f->pivot_count += tape_of(model, k)->pivots[i];
  const int loops = fmu_loops_new(f);
  f->memory = loops ? calloc((size_t)place_memory(f) + 1, sizeof(double)) : 0;
  f->pivots = calloc((size_t)f->pivot_count + 1, sizeof(int32_t));
  if (!f->memory || !f->pivots) {
    fmu_free(f);
    return 0;
  }
  place_memory(f);
  int32_t *pivots = f->pivots;
  for (int k = 0; k < TAPES; k++)
    if (!make_tape(f, k, &pivots)) {
      fmu_free(f);
      return 0;
    }
  f->orders = order_count(f);
  f->order = calloc((size_t)f->orders + 1, sizeof(double));
  if (!f->order) {
    fmu_free(f);
    return 0;
  }
  const int64_t n = model->states;
  f->call = (lmoc_call){.w = f->w[RIGHT], .tape = f->tape + RIGHT, .n = n, .given = n, .first_state = -1,
                        .states = model->state, .derivatives = model->derivative,
                        .remembered = remembered(&model->right), .unknowns = model->unknown, .solution = f->solution,
                        .x = f->solution_x, .last = &f->last};
  fmu_reset(f);
  return f;
}

void fmu_free(fmu *f) {
  if (!f) return;
  for (int k = 0; k < TAPES; k++)
    if (f->blocks[k]) {
      for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) lmoc_lu_free(f->blocks[k][i].lu);
      free(f->blocks[k]);
    }
  fmu_loops_free(f);
  lmoc_roots_free(&f->finder);
  free(f->memory);
  free(f->order);
  free(f->pivots);
  free(f);
}

/* ------------------------------------------------------------------ saved states */

/* Sparse factors: whether their order of pivots has been chosen, and for which values. */
static void save_orders(const fmu *f, double *to) {
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) {
      const lmoc_lu *lu = f->blocks[k][i].lu;
      if (!lu) continue;
      *to++ = (double)lu->ready;
      memcpy(to, lu->chosen, (size_t)lu->start[lu->n] * sizeof(double));
      to += lu->start[lu->n];
    }
}

static int restore_orders(fmu *f, const double *from) {
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) {
      lmoc_lu *lu = f->blocks[k][i].lu;
      if (!lu) continue;
      const int ready = *from++ != 0;
      memcpy(lu->chosen, from, (size_t)lu->start[lu->n] * sizeof(double));
      from += lu->start[lu->n];
      lmoc_lu_forget(lu);
      if (ready && lmoc_lu_choose(lu, lu->chosen) != LMOC_LU_GOOD) return 0;
    }
  return 1;
}

size_t fmu_bytes(const fmu *f) {
  return 64 + sizeof(fmu_scalars) + (f->doubles + f->orders) * sizeof(double) + f->pivot_count * sizeof(int32_t);
}

static void head(const fmu *f, unsigned char *to) {
  memset(to, 0, 64);
  for (int i = 0; i < 63 && f->model->token[i]; i++) to[i] = (unsigned char)f->model->token[i];
}

/* Nothing changes here: a run goes on to the bit as if it had not been saved. */
void fmu_save(fmu *f, unsigned char *to) {
  f->now.call_time = f->call.time;
  f->now.marked_time = f->call.marked_time;
  f->now.solved = f->call.solved;
  f->now.marked = f->call.marked;
  f->now.stands = f->last != 0;
  head(f, to);
  memcpy(to += 64, &f->now, sizeof f->now);
  memcpy(to += sizeof f->now, f->memory, f->doubles * sizeof(double));
  to += f->doubles * sizeof(double);
  save_orders(f, f->order);
  memcpy(to, f->order, f->orders * sizeof(double)); /* bytes need not stand where numbers may */
  memcpy(to + f->orders * sizeof(double), f->pivots, f->pivot_count * sizeof(int32_t));
}

int fmu_restore(fmu *f, const unsigned char *from, size_t size) {
  unsigned char own[64];
  head(f, own);
  if (size != fmu_bytes(f) || memcmp(own, from, 64)) return fmu_refused(f, "the saved state is one of another FMU");
  memcpy(&f->now, from += 64, sizeof f->now);
  memcpy(f->memory, from += sizeof f->now, f->doubles * sizeof(double));
  from += f->doubles * sizeof(double);
  memcpy(f->order, from, f->orders * sizeof(double));
  memcpy(f->pivots, from + f->orders * sizeof(double), f->pivot_count * sizeof(int32_t));
  f->call.time = f->now.call_time;
  f->call.marked_time = f->now.marked_time;
  f->call.solved = f->now.solved;
  f->call.marked = f->now.marked;
  f->last = f->now.stands ? &f->call : 0;
  fmu_forget(f);
  return restore_orders(f, f->order) ? FMU_GOOD : fmu_refused(f, "there is no memory for the factors of a saved state");
}
