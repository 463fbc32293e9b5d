/* What FMI 2.0 and 3.0 have in common: values, states, steps. */

#include "discrete.h"
#include "fmu_laws.h"
#include "fmu_loops.h"

#include <stdio.h>
#include <stdlib.h>

static const double SHORTEST = 8e-16; /* share of the time, up to which DOP853 has no step (`engine/c/walk.c`) */
enum { STANDING = 1000 };             /* events in a row between which the time does not go on */

static const fmu_tape *tape_of(const fmu_model *m, int k) {
  const fmu_events *e = &m->events;
  const fmu_tape *all[] = {&m->parametric, &m->right, &m->observe, &m->slopes, &e->look, &e->assign, &e->line, &e->begin,
                           &m->laws.by_force, &m->laws.by_state, &m->jumps.rates,
                           &m->loops.stage[0].tape, &m->loops.stage[1].tape};
  return all[k];
}

/* ------------------------------------------------------------------ instances */

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
  TAKE(known, 5*laws);
  TAKE(restitution, laws);
  TAKE(errors, m->states);
  TAKE(unresolved, m->states);
  fmu_law_ask(f);
  total += lmoc_law_place(&f->laws, at ? at + total : 0);
  total += fmu_loops_place(f, at ? at + total : 0);
  f->doubles = total;
  TAKE(work, 32*m->states + 4);
  TAKE(noise, 3*i->zeros + m->states);
  TAKE(e.history, i->discrete * LMOC_HISTORY);
  TAKE(e.supposed, i->relations);
  TAKE(e.changed, i->discrete);
  TAKE(e.flipped, i->discrete);
  TAKE(moved, 5*m->states);
  TAKE(root, 4*fmu_roots(f));
  TAKE(which, i->zeros);
  TAKE(turn, i->zeros);
  TAKE(before, m->states);
  TAKE(at, i->zeros);
  TAKE(hops.work, 4*m->states + 9*i->zeros);
  TAKE(law_read, 4*laws);
  TAKE(law_before, m->states);
  TAKE(law_moved, m->states);
  TAKE(step, fmu_jump_room(m));
  TAKE(before_event, i->discrete);
  TAKE(at_event, i->discrete);
  total += fmu_loops_scratch(f, at ? at + total : 0);
  double *scratch;
  scratch = at ? at + total : 0, total += i->told;
  f->e.found = (int64_t *)scratch;
  f->law_which = (lmoc_flag *)(at ? at + total : 0), total += (2*laws + 7) / 8;
  f->e.moved = f->moved;
  f->e.v = f->w[ASSIGN];
  f->e.line = f->w[LINES];
  f->e.assign = f->tape + ASSIGN;
  f->e.lines = f->tape + LINES;
#undef TAKE
  return total;
}

static void forget(fmu *f) {
  for (int k = 0; k < TAPES; k++)
    for (int64_t i = 0; i < tape_of(f->model, k)->block_count; i++) {
      lmoc_block *b = f->blocks[k] + i;
      b->ready = 0;
      if (b->lu) lmoc_lu_forget(b->lu);
    }
}

/* Nonlinear blocks begin as the scene is at its start. */
static void guess(fmu *f) {
  const fmu_model *m = f->model;
  const int tapes[] = {RIGHT, OBSERVE, LOOK, BY_FORCE, BY_STATE};
  for (size_t k = 0; k < (m->laws.laws.count ? 5 : 3); k++)
    for (int64_t i = 0; i < m->unknowns; i++) f->w[tapes[k]][m->unknown[i]] = m->guess[i];
}

void fmu_reset(fmu *f) {
  const fmu_model *m = f->model;
  const int co_simulation = f->now.co_simulation;
  f->now = (fmu_scalars){.time = m->start_time, .begin = m->start_time, .rtol = m->tolerance, .phase = FMU_FRESH,
                         .co_simulation = co_simulation, .stale = 1, .next = INFINITY};
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
  guess(f);
  forget(f);
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

/* ------------------------------------------------------------------ values */

void fmu_changed(fmu *f) {
  f->now.evaluated = f->now.observed = 0;
  f->last = 0;
}

/* Parameters and inputs into the registers. */
void fmu_settle(fmu *f) {
  const fmu_model *m = f->model;
  const fmu_events *e = &m->events;
  const int renewed = f->now.stale, runs = !(f->now.phase & (FMU_FRESH | FMU_INITIALIZING | FMU_CONFIGURING));
  for (int64_t i = 0; i < m->inputs; i++) f->w[RIGHT][m->input[i]] = f->u[i];
  if (renewed) {
    if (runs && m->laws.laws.count) fmu_law_look(f);
    double *w = f->w[PARAMETRIC];
    for (int64_t i = 0; i < m->parameters; i++) w[m->parameter[i]] = f->p[i];
    forget(f);
    lmoc_tape_run(NAN, w, f->tape + PARAMETRIC);
    fmu_law_parameters(f);
    fmu_loops_parameters(f);
    for (int64_t i = 0; i < m->given; i++) f->w[RIGHT][m->given_registers[i]] = w[m->given_registers[i]];
    for (int k = LOOK; k <= BEGIN; k++)
      for (int64_t i = 0; i < e->parameters; i++) f->w[k][e->parameter_registers[i]] = w[e->parameter_registers[i]];
    if (!runs) { /* later the last solution is the nearest */
      guess(f);
      f->call.solved = f->call.marked = f->now.closed = 0;
    }
    f->now.stale = f->now.fits = 0;
    fmu_changed(f);
  }
  for (int64_t i = 0; i < f->e.discrete; i++)
    if (f->w[RIGHT][e->registers[i]] != f->e.v[f->e.own[i]]) {
      f->w[RIGHT][e->registers[i]] = f->e.v[f->e.own[i]];
      f->call.solved = f->call.marked = 0; /* the equations are others: their solution may be elsewhere */
      fmu_changed(f);
    }
  if (!m->laws.laws.count) return;
  fmu_law_mode(f);
  if (!renewed) return;
  fmu_law_given(f);
  lmoc_law_renew(&f->laws);
  if (runs) fmu_law_compare(f);
}

int fmu_fits(fmu *f) {
  const fmu_model *m = f->model;
  fmu_settle(f);
  for (int64_t i = 0; i < m->assumed && !f->now.fits; i++) {
    if (f->w[PARAMETRIC][m->assumption[i]] != 0) continue;
    if (m->assumption_error[i]) return fmu_refused(f, m->assumption_texts[i]);
    f->warn(f->owner, m->assumption_texts[i]);
  }
  f->now.fits = 1;
  return FMU_GOOD;
}

int fmu_lost(fmu *f) {
  f->tell(f->owner, "the equations of a nonlinear block have no solution near the last one");
  return FMU_NO_VALUE;
}

/* The equations at a place; loops are closed first as the scene is at its start, from where the way leads there. */
int fmu_solve(fmu *f, double time, const double *x) {
  if (f->call.remembered && !f->now.closed) lmoc_evaluate(&f->call, f->model->start_time, f->model->start);
  if (!lmoc_evaluate(&f->call, time, x)) {
    f->now.closed = 1;
    return FMU_GOOD;
  }
  return fmu_lost(f);
}

int fmu_look(fmu *f, double time, const double *x) {
  const fmu_events *e = &f->model->events;
  fmu_settle(f);
  f->now.evaluated = f->now.observed = 0;
  if (fmu_solve(f, time, x)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < e->kept; i++) f->w[LOOK][e->kept_registers[i]] = f->w[RIGHT][e->kept_registers[i]];
  return lmoc_tape_run(time, f->w[LOOK], f->tape + LOOK) & LMOC_FAILED ? FMU_NO_VALUE : FMU_GOOD;
}

static int evaluate(fmu *f) {
  if (fmu_fits(f)) return FMU_WRONG;
  if (!f->now.begun && !f->now.settled && (f->e.discrete || f->model->laws.laws.count || f->model->loops.stages)) {
    const int found = fmu_begin(f, 0);
    f->now.settled = !found;
    if (found) return found;
  }
  if (f->now.evaluated) return FMU_GOOD;
  if (fmu_solve(f, f->now.time, f->x)) return FMU_NO_VALUE;
  f->now.evaluated = 1;
  return FMU_GOOD;
}

static int observe(fmu *f) {
  const fmu_model *m = f->model;
  const int found = evaluate(f);
  if (found || f->now.observed) return found;
  for (int64_t i = 0; i < m->kept; i++) f->w[OBSERVE][m->kept_registers[i]] = f->w[RIGHT][m->kept_registers[i]];
  if (lmoc_tape_run(f->now.time, f->w[OBSERVE], f->tape + OBSERVE) & LMOC_FAILED) return FMU_NO_VALUE;
  f->now.observed = 1;
  return FMU_GOOD;
}

int fmu_get(fmu *f, uint32_t reference, double *value) {
  const fmu_model *m = f->model;
  if (!reference) {
    *value = f->now.time;
    return FMU_GOOD;
  }
  const int64_t row = (int64_t)reference - 1;
  if (row >= m->variables) {
    f->tell(f->owner, "there is no variable with this value reference");
    return FMU_WRONG;
  }
  const int32_t place = m->place[row];
  int found = FMU_GOOD;
  switch (m->kind[row]) {
    case FMU_PARAMETER: *value = f->p[place]; break;
    case FMU_DISCRETE:
      found = evaluate(f);
      *value = f->e.v[f->e.own[place]];
      break;
    case FMU_INDICATOR:
      found = evaluate(f);
      if (!found) found = fmu_indicators(f, f->now.time, f->x, f->root);
      *value = found ? NAN : f->root[place];
      break;
    case FMU_DERIVED: fmu_settle(f); *value = f->w[PARAMETRIC][place]; break;
    case FMU_STATE:
      if (m->loops.stages && !f->now.begun) found = evaluate(f); /* they follow from others */
      *value = f->x[place];
      break;
    case FMU_INPUT: *value = f->u[place]; break;
    case FMU_DERIVATIVE:
      found = evaluate(f);
      *value = found ? NAN : f->w[RIGHT][m->derivative[place]];
      break;
    default:
      found = observe(f);
      *value = found ? NAN : f->w[OBSERVE][place];
  }
  return found;
}

int fmu_refused(fmu *f, const char *text) {
  f->tell(f->owner, text);
  return FMU_WRONG;
}

int fmu_set(fmu *f, uint32_t reference, double value) {
  const fmu_model *m = f->model;
  const int64_t row = (int64_t)reference - 1;
  const int phase = f->now.phase, before = phase & (FMU_FRESH | FMU_INITIALIZING | FMU_CONFIGURING);
  if (!reference || row >= m->variables) return fmu_refused(f, "there is no variable with this value reference to be set");
  if (!(value * 0 == 0)) return fmu_refused(f, "a variable was set to what is no finite number");
  const int32_t place = m->place[row];
  switch (m->kind[row]) {
    case FMU_PARAMETER:
      if (!before && !(phase & FMU_EVENT) && !(f->now.co_simulation && phase & FMU_STEPPING))
        return fmu_refused(f, "parameters can be set before initialization and at events");
      if (!before && m->loops.stages && m->loops.closing[place])
        return fmu_refused(f, "a parameter that closed loops depend on can be set before and in initialization");
      f->now.stale |= f->p[place] != value;
      f->p[place] = value;
      break;
    case FMU_STATE:
      if (!before) return fmu_refused(f, "the start value of a state can be set before and in initialization");
      if (m->loops.stages && m->loops.held[place] != 0)
        return fmu_refused(f, "this state follows from others where its loops are closed, and cannot be set");
      f->x[place] = value;
      break;
    case FMU_INPUT:
      f->u[place] = value;
      break;
    default:
      return fmu_refused(f, "this variable is calculated, and cannot be set");
  }
  if (before) f->now.settled = 0;
  fmu_changed(f);
  return FMU_GOOD;
}

int fmu_state_of(const fmu *f, uint32_t reference) {
  const int64_t row = (int64_t)reference - 1;
  return reference && row < f->model->variables && f->model->kind[row] == FMU_STATE ? f->model->place[row] : -1;
}

int fmu_derivatives(fmu *f, double *out) {
  const int found = evaluate(f);
  double check = 0;
  for (int64_t i = 0; i < f->model->states; i++) {
    out[i] = found ? NAN : f->w[RIGHT][f->model->derivative[i]];
    check += out[i] * 0;
  }
  return found ? found : check == 0 ? FMU_GOOD : FMU_NO_VALUE;
}

int fmu_states(fmu *f, double *out) {
  const int found = f->model->loops.stages && !f->now.begun ? evaluate(f) : FMU_GOOD; /* they follow from others */
  memcpy(out, f->x, (size_t)f->model->states * sizeof(double));
  return found;
}

void fmu_set_time(fmu *f, double time) {
  if (time != f->now.time) fmu_changed(f);
  f->now.time = time;
}

void fmu_set_states(fmu *f, const double *x) {
  memcpy(f->x, x, f->model->states * sizeof(double));
  fmu_changed(f);
}

/* ------------------------------------------------------------------ steps */

/* Whether the closures of loops still stand as they did at the start: where one of their determinants changes its sign,
   the motion has passed a place where these coordinates do not tell where the mechanism goes. */
static int stands(fmu *f) {
  int64_t at = 0;
  if (!f->model->branches) return 1;
  for (int64_t i = 0; i < f->model->right.block_count; i++) {
    const lmoc_block *b = f->blocks[RIGHT] + i;
    for (int64_t j = 0; b->work && j < b->instances; j++, at++) {
      const double det = f->w[RIGHT][b->work + j];
      if (!f->now.judged) f->sign[at] = det;
      else if (!(det * f->sign[at] > 0)) return 0;
    }
  }
  f->now.judged = 1;
  return 1;
}

static int look(void *own, double time, const double *x, int first) {
  const fmu *f = own;
  (void)first;
  return !stands(own) || (f->model->loops.stages && fmu_loops_look(own, time, x));
}

static void keep(void *own) {
  fmu *f = own;
  lmoc_mark(&f->call);
  if (f->model->loops.stages) fmu_loops_keep(f);
}

int fmu_accept(fmu *f) {
  const int found = evaluate(f);
  int looked;
  if (found) return found;
  if (!stands(f)) {
    f->tell(f->owner, "the mechanism has come to where its coordinates no longer tell where it goes");
    return FMU_WRONG;
  }
  if (f->model->loops.stages && (looked = fmu_loops_accept(f))) return looked;
  if (fmu_roots(f)) {
    if (fmu_look(f, f->now.time, f->x)) return FMU_NO_VALUE;
    fmu_seen(f);
    fmu_followed(f);
  }
  lmoc_mark(&f->call);
  return fmu_holds(f);
}

double fmu_next_break(const fmu *f) {
  const int64_t k = f->now.first_break;
  return k < f->model->breaks ? f->model->break_times[k] : INFINITY;
}

double fmu_next(const fmu *f) { return fmin(fmu_next_break(f), f->now.next); }

/* The tolerance of steps, with which a run as a whole keeps the one that is asked for. */
static double tolerance(const fmu *f) {
  return fmax(f->now.rtol * f->model->finer, fmin(f->now.rtol, f->model->no_finer));
}

static double first_step(fmu *f, double span, const double *slope, const double *atol, double *x, double *trial) {
  const int64_t n = f->model->states;
  /* where all states are next to zero their sizes ask for a step that is none by rounding */
  const double least = fmax(f->model->rules.least, 2 * SHORTEST * fabs(f->now.time));
  const double h = lmoc_first_trial(n, span, INFINITY, least, tolerance(f), atol, f->x, slope);
  for (int64_t i = 0; i < n; i++) x[i] = f->x[i] + h*slope[i];
  lmoc_derivatives(&f->call, f->now.time + h, x, trial);
  return lmoc_first_step(n, h, span, tolerance(f), atol, f->x, slope, trial);
}

/* The states within the last step. */
static int within(void *own, double time, double *x) {
  const lmoc_steps *s = own;
  lmoc_dop853_within(s, (time - s->before) / s->length, x);
  return 0;
}

/* Whether something happens within the last step, which has begun at `s->x`; then it ends there. */
static int happens_within(fmu *f, lmoc_steps *s, double *end, int *root) {
  lmoc_dop853_dense(s);
  const int found = fmu_first_root(f, s->before, s->t, within, s, end);
  *root = !found && *end < INFINITY;
  if (*root) within(s, *end, f->moved);
  return found;
}

/* Whether a step that has been found too long to be judged can be made again, and shorter. */
static int again(fmu *f, lmoc_steps *s, int status) {
  if (status != LMOC_DOUBTFUL || !f->model->loops.stages) return 0;
  if (f->call.marked) lmoc_go_back(&f->call);
  s->step_size = s->length / 4;
  s->grow = 1;
  return 1;
}

/* Integrate over what is smooth, as long as nothing happens; `root`: something does where it has ended. */
static int smooth(fmu *f, double end, int *root) {
  const fmu_model *m = f->model;
  const int64_t n = m->states;
  double *at = f->work, *k = at, *slope = k + 16*n, *x_new = slope + n, *last = x_new + n, *terms = last + n,
         *landed = terms + 7*n, *atol = landed + n, *begin = atol + n;
  const int found = fmu_derivatives(f, slope), watched = fmu_roots(f) > 0;
  if (found) return found;
  for (int64_t i = 0; i < n; i++) atol[i] = tolerance(f) * 1e-3 * m->nominal[i];
  if (!(f->now.wish > 0)) f->now.wish = first_step(f, end - f->now.time, slope, atol, x_new, last);
  const lmoc_step_hook hook = {f, look, m->loops.stages ? fmu_loops_land : lmoc_law_drifts(&f->laws) ? fmu_law_keep : 0, keep, 0};
  lmoc_steps s = {.call = &f->call, .rules = &m->rules, .weights = m->weights, .nodes = m->nodes, .dense = m->dense,
                  .omitted = m->omitted, .atol = atol, .x = f->x, .f = slope, .x_new = x_new, .k = k, .last = last,
                  .terms = terms, .landed = landed, .t = f->now.time, .before = f->now.time, .step_size = f->now.wish,
                  .grow = m->rules.grow, .cuts_since = f->now.time, .rtol = tolerance(f), .end = end,
                  .max_step = m->events.longest, .patience = INFINITY, .most = watched ? 1 : INT64_MAX, .hook = &hook};
  int status = 0, shorter, doubted = 0;
  do {
    const double wished = s.step_size;
    memcpy(begin, f->x, n * sizeof(double));
    status = lmoc_dop853_walk(&s);
    const int cut = s.steps == 1 && !s.rejected && s.length < wished; /* at the end: no shorter */
    shorter = again(f, &s, status);
    doubted = shorter || (doubted && !s.steps);
    f->now.wish = cut ? wished : s.step_size;
    if (watched && s.steps) {
      double until = s.t;
      s.x = begin;
      const int wrong = happens_within(f, &s, &until, root);
      s.x = f->x;
      if (wrong) return wrong;
      if (*root) {
        memcpy(f->x, f->moved, n * sizeof(double));
        s.t = until;
        shorter = 0;
        if (m->loops.stages && fmu_loops_land(f, until, f->x)) return fmu_loops_depend(f);
      }
    }
  } while (shorter || (watched && !status && !*root && s.t < end));
  f->now.time = s.t;
  fmu_changed(f);
  if (!status || *root) return FMU_GOOD;
  if (doubted) return fmu_loops_depend(f);
  if (status == LMOC_DOUBTFUL)
    f->tell(f->owner, "the mechanism has come to where its coordinates no longer tell where it goes");
  else f->tell(f->owner, "no step is short enough: the equations have no solution beyond");
  return FMU_NO_VALUE;
}

/* The same where there are no states. */
static int pass_time(fmu *f, double end, int *root) {
  while (fmu_roots(f) && f->now.time < end && !*root) {
    const double to = fmin(end, f->now.time + f->model->events.longest);
    double at;
    const int found = fmu_first_root(f, f->now.time, to, 0, 0, &at);
    if (found) return found;
    *root = at < INFINITY;
    f->now.time = *root ? at : to;
    fmu_changed(f);
  }
  return FMU_GOOD;
}

/* Do what happens now; 1 where the model ends it. */
static int happen(fmu *f, int *found) {
  f->now.wish = 0;
  *found = fmu_happen(f);
  f->located = 0;
  if (!*found) *found = fmu_holds(f);
  return *found || f->now.ended;
}

/* What is found again wherever it has happened would be so for ever. */
static int stands_still(fmu *f) {
  char text[200];
  snprintf(text, sizeof text, "events follow each other without end at t = %.15g s: the time does not go on", f->now.time);
  return fmu_refused(f, text);
}

int fmu_advance(fmu *f, double end) {
  int found = evaluate(f), standing = 0;
  if (found) return found;
  if (fmu_passed(f) && happen(f, &found)) return found; /* inputs and parameters may have been set */
  while (f->now.time < end) {
    const double jump = fmu_next_break(f), next = fmin(fmu_next(f), end);
    /* the last stage of a step before a jump must not see what comes behind it */
    const double until = jump <= next ? next - 4e-16*fabs(next) : next, from = f->now.time;
    int root = 0;
    if (until - f->now.time > SHORTEST * fabs(until)) { /* an ulp is no step: a tick just before a communication point */
      found = f->model->states ? smooth(f, until, &root) : pass_time(f, until, &root);
      if (found) return found;
      f->located = root;
    }
    if (!root) {
      f->now.time = next;
      fmu_changed(f);
      if (jump <= next) {
        f->now.wish = 0;
        root = fmu_passed(f) || f->model->jumps.count;
        if (!root) found = fmu_input_steps(f);
      }
    }
    standing = f->now.time - from > SHORTEST * fabs(from) ? 0 : standing + 1;
    if (standing > STANDING) return stands_still(f);
    if ((root || f->now.time >= f->now.next) && happen(f, &found)) return found;
  }
  return evaluate(f);
}

/* ------------------------------------------------------------------ derivatives in a direction */

static int64_t row_of(const fmu_model *m, uint32_t reference) {
  const int64_t row = (int64_t)reference - 1;
  if (!reference || row >= m->variables) return -1;
  if (m->kind[row] == FMU_DERIVATIVE) return m->place[row];
  if (m->kind[row] != FMU_OBSERVED && m->kind[row] != FMU_STATE) return -1;
  const int32_t wanted = m->kind[row] == FMU_STATE ? m->state[m->place[row]] : m->place[row];
  for (int64_t k = 0; k < m->states; k++)
    if (m->derivative[k] == wanted) return k;
  for (int64_t k = 0; k < m->outputs; k++)
    if (m->output[k] == wanted) return m->states + k;
  return -1;
}

static int64_t column_of(const fmu_model *m, uint32_t reference) {
  const int64_t row = (int64_t)reference - 1;
  if (!reference || row >= m->variables) return -1;
  if (m->kind[row] == FMU_STATE) return m->place[row];
  return m->kind[row] == FMU_INPUT ? m->states + m->place[row] : -1;
}

int fmu_directional(fmu *f, const uint32_t *unknowns, size_t rows, const uint32_t *knowns, size_t columns,
                    const double *seed, double *out, int adjoint) {
  const fmu_model *m = f->model;
  int found = observe(f);
  if (found) return found;
  double *w = f->w[SLOPES];
  memcpy(w, f->w[OBSERVE], m->registers * sizeof(double));
  lmoc_tape_run(f->now.time, w, f->tape + SLOPES);
  for (size_t i = 0; i < (adjoint ? columns : rows); i++) out[i] = 0;
  for (size_t j = 0; j < columns; j++) {
    const int64_t column = column_of(m, knowns[j]);
    if (column < 0) return fmu_refused(f, "derivatives are by states and inputs");
    for (size_t i = 0; i < rows; i++) {
      const int64_t row = row_of(m, unknowns[i]);
      if (row < 0) return fmu_refused(f, "only derivatives and outputs have directional derivatives");
      for (int64_t e = 0; e < m->slopes.result_count; e++)
        if (m->rows[e] == row && m->columns[e] == column) {
          const double value = w[m->slopes.results[e]];
          if (!(value * 0 == 0)) found = FMU_NO_VALUE;
          out[adjoint ? j : i] += value * seed[adjoint ? i : j];
        }
    }
  }
  return found;
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
  forget(f);
  return restore_orders(f, f->order) ? FMU_GOOD : fmu_refused(f, "there is no memory for the factors of a saved state");
}
