/* Closed loops whose coordinates are all states: the formulation `projected` in an FMU, on the tapes of
   `export/loops.py`. There is one state vector for the whole motion, whatever minimal coordinates would serve where, as
   Model Exchange asks for. Co-Simulation moves the end of each step onto the closures, as `simulate` does. In Model
   Exchange the other side makes the steps: what it has drifted off them is made good by a step event. */

#include "fmu_loops.h"

#include <stdlib.h>

static const double DRIFT = 0.1;     /* of the tolerance: from there on the states are moved back onto the closures … */
static const double FAR = 1;         /* … and from there on whatever that crosses */
enum { IS_CLOSED, MAY_WAIT, MUST_RETURN };
static const double DEPENDENT = 1e-4; /* smallest singular value: below it closures depend on each other */
enum { PIECES = 16 };                /* into which a step of the other side is divided to look at it closely */

/* ------------------------------------------------------------------ instances */

int fmu_loops_new(fmu *f) {
  const fmu_loops *m = &f->model->loops;
  for (int64_t k = 0; k < m->stages; k++) {
    const fmu_closures *own = m->stage + k;
    lmoc_closure_stage *s = f->stage + k;
    if (!(s->group = calloc((size_t)own->groups + 1, sizeof *s->group))) return 0;
    s->residuals = own->residuals;
    s->entries = own->entries;
    s->groups = own->groups;
    s->tape = f->tape + POSITIONS + k;
    s->results = own->tape.results;
    memcpy(s->group, own->group, (size_t)own->groups * sizeof *s->group);
  }
  f->closures = (lmoc_closures){f->model->states, m->stages, f->model->state, m->scale, f->stage, DEPENDENT, {0, 0}, {0, 0}};
  return 1;
}

void fmu_loops_free(fmu *f) {
  for (int64_t k = 0; k < f->model->loops.stages; k++) free(f->stage[k].group);
}

int64_t fmu_loops_place(fmu *f, double *at) {
  const fmu_loops *m = &f->model->loops;
  int64_t total = 0;
#define TAKE(name, count) (name = at ? at + total : 0, total += (count))
  for (int64_t k = 0; k < m->stages; k++)
    for (int64_t j = 0; j < m->stage[k].groups; j++) {
      lmoc_loops *g = f->stage[k].group + j;
      TAKE(g->sizes, g->loops * g->m);
      TAKE(g->kept, g->loops * g->m * g->n);
      TAKE(g->margins, 3 * g->loops);
    }
  TAKE(f->loop_x, m->stages ? f->model->states : 0);
  return total;
}

int64_t fmu_loops_scratch(fmu *f, double *at) {
  const fmu_loops *m = &f->model->loops;
  int64_t total = 0;
  for (int64_t k = 0; k < m->stages; k++) {
    f->stage[k].w = f->w[POSITIONS + k];
    TAKE(f->stage[k].out, m->stage[k].entries + m->stage[k].residuals);
    for (int64_t j = 0; j < m->stage[k].groups; j++) {
      lmoc_loops *g = f->stage[k].group + j;
      TAKE(g->last, g->loops * g->m * g->n);
      TAKE(g->now, g->loops * g->m * g->n);
      TAKE(g->work, g->m * (g->m + 2));
    }
  }
  TAKE(f->loop_moved, m->stages ? f->model->states : 0);
  TAKE(f->loop_wanted, m->stages ? f->model->states : 0);
  TAKE(f->loop_before, m->stages ? f->model->states : 0);
  TAKE(f->loop_sizes, m->stages ? f->model->states : 0);
  TAKE(f->loop_p, m->stages ? f->model->parameters : 0);
#undef TAKE
  return total;
}

void fmu_loops_parameters(fmu *f) {
  const fmu_loops *m = &f->model->loops;
  for (int64_t k = 0; k < m->stages; k++)
    for (int64_t i = 0; i < m->given; i++) f->w[POSITIONS + k][m->given_registers[i]] = f->w[PARAMETRIC][m->given_registers[i]];
}

int fmu_loops_depend(fmu *f) {
  f->tell(f->owner, "the closures of its loops depend on each other here: a singular position, beyond which the motion may "
                    "continue along another branch");
  return FMU_NO_VALUE;
}

static void stay(fmu *f) {
  lmoc_keep(&f->closures);
  memcpy(f->loop_x, f->x, (size_t)f->model->states * sizeof(double));
  f->now.loop_time = f->now.time;
}

int fmu_loops_stand(fmu *f) {
  if (lmoc_look(&f->closures, f->now.time, f->x, -1)) return fmu_loops_depend(f);
  stay(f);
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ along a way */

/* Go to the end of a way on the closures, in pieces as short as it takes: `stand` moves a state to a share of it, from where
   it has been before. Returns 0 where it comes there. */
static int reach(fmu *f, int (*stand)(fmu *f, double share, double *x), double *x, double *before) {
  const size_t size = (size_t)f->model->states * sizeof(double);
  double share = 0, step = 1;
  while (share < 1 && step > 0x1p-20) {
    const double next = fmin(share + step, 1);
    memcpy(before, x, size);
    if (stand(f, next, x)) {
      memcpy(x, before, size);
      step /= 2;
    } else {
      share = next;
      step *= 2;
    }
  }
  return share < 1;
}

/* ------------------------------------------------------------------ the start */

/* Stand at a share of the way from the scene's own start to what is wanted: parameters, time, states that are given. The
   others follow where that is a short way. */
static int stand(fmu *f, double share, double *x) {
  const fmu_model *m = f->model;
  for (int64_t i = 0; i < m->parameters; i++)
    f->p[i] = share < 1 ? m->parameter_start[i] + share * (f->loop_p[i] - m->parameter_start[i]) : f->loop_p[i];
  f->now.stale = 1;
  fmu_settle(f);
  for (int64_t i = 0; i < m->states; i++)
    if (m->loops.held[i] == 0) x[i] = share < 1 ? m->start[i] + share * (f->loop_wanted[i] - m->start[i]) : f->loop_wanted[i];
  const double time = share < 1 ? m->start_time + share * (f->now.time - m->start_time) : f->now.time;
  f->closures.scale = m->loops.held;
  const int found = lmoc_land(&f->closures, time, x);
  f->closures.scale = m->loops.scale;
  return found;
}

int fmu_loops_begin(fmu *f) {
  const fmu_model *m = f->model;
  const size_t size = (size_t)m->states * sizeof(double);
  double *x = f->loop_moved;
  memcpy(f->loop_p, f->p, (size_t)m->parameters * sizeof(double));
  memcpy(f->loop_wanted, f->x, size);
  memcpy(x, m->start, size);
  for (int64_t k = 0; k < m->loops.stages; k++)
    for (int64_t j = 0; j < m->loops.stage[k].groups; j++) {
      lmoc_loops *g = f->stage[k].group + j;
      for (int64_t i = 0; i < g->loops * g->m; i++) g->sizes[i] = 1e-300;
    }
  const int lost = reach(f, stand, x, f->loop_before);
  memcpy(f->p, f->loop_p, (size_t)m->parameters * sizeof(double));
  f->now.stale = 1;
  memcpy(f->x, lost ? f->loop_wanted : x, size);
  fmu_settle(f);
  fmu_changed(f);
  if (lost) {
    f->tell(f->owner, "no way leads from where the loops are closed at the start of the scene to these values");
    return FMU_NO_VALUE;
  }
  f->now.drifted = IS_CLOSED;
  return fmu_loops_stand(f);
}

/* ------------------------------------------------------------------ events */

/* Stand at a share of the way of those velocities that have been moved. */
static int move(fmu *f, double share, double *x) {
  const fmu_model *m = f->model;
  for (int64_t i = 0; i < m->states; i++)
    if (f->loop_sizes[i] == 0) x[i] = share < 1 ? f->x[i] + share * (f->loop_wanted[i] - f->x[i]) : f->loop_wanted[i];
  f->closures.scale = f->loop_sizes;
  const int found = lmoc_land_rates(&f->closures, f->now.time, x);
  f->closures.scale = m->loops.scale;
  return found;
}

int fmu_loops_follow(lmoc_instant *e, const double *x, double *moved) {
  fmu *f = e->owner;
  const fmu_model *m = f->model;
  const size_t size = (size_t)m->states * sizeof(double);
  memcpy(f->loop_wanted, moved, size);
  for (int64_t i = 0; i < m->states; i++) f->loop_sizes[i] = moved[i] != x[i] ? 0 : m->loops.scale[i];
  memcpy(moved, x, size);
  if (reach(f, move, moved, f->loop_before)) return fmu_refused(f, "loops cannot be closed with the values of a `reinit`");
  return FMU_GOOD;
}

/* ------------------------------------------------------------------ steps */

int fmu_loops_look(void *own, double time, const double *x) { return lmoc_look(&((fmu *)own)->closures, time, x, 1); }

int fmu_loops_land(void *own, double time, double *x) { return lmoc_land(&((fmu *)own)->closures, time, x); }

void fmu_loops_keep(void *own) { lmoc_keep(&((fmu *)own)->closures); }

/* Whether the closures keep their rank along a step, the way of which is taken for straight. */
static int keeps_rank(fmu *f, int pieces) {
  double *x = f->loop_moved;
  for (int k = 1; k <= pieces; k++) {
    const double share = (double)k / pieces;
    for (int64_t i = 0; i < f->model->states; i++)
      x[i] = k == pieces ? f->x[i] : f->loop_x[i] + share * (f->x[i] - f->loop_x[i]);
    const double time = k == pieces ? f->now.time : f->now.loop_time + share * (f->now.time - f->now.loop_time);
    if (lmoc_look(&f->closures, time, x, k == 1)) return 0;
  }
  return 1;
}

int fmu_loops_accept(fmu *f) {
  const fmu_model *m = f->model;
  double *x = f->loop_moved, most = 0;
  if (!keeps_rank(f, 1) && !keeps_rank(f, PIECES)) {
    fmu_loops_depend(f);
    return FMU_WRONG;
  }
  stay(f);
  if (f->now.time >= fmu_next_break(f) - lmoc_near_to(f->now.time)) { /* formulas of time are those behind it, the states not */
    f->now.drifted = IS_CLOSED;
    return FMU_GOOD;
  }
  memcpy(x, f->x, (size_t)m->states * sizeof(double));
  if (lmoc_land(&f->closures, f->now.time, x))
    return fmu_refused(f, "the states have drifted too far from where the loops are closed: a smaller tolerance helps");
  for (int64_t i = 0; i < m->states; i++)
    most = fmax(most, fabs(x[i] - f->x[i]) / (f->now.rtol * (fabs(x[i]) + 1e-3 * m->nominal[i])));
  f->now.drifted = most <= DRIFT ? IS_CLOSED : most <= FAR ? MAY_WAIT : MUST_RETURN;
  return FMU_GOOD;
}

/* Whether functions of events have other signs than before, which are `f->root`. */
static int crosses(fmu *f) {
  const int64_t count = fmu_roots(f);
  double *values = f->root + count;
  if (!count || fmu_indicators(f, f->now.time, f->x, values)) return 0;
  for (int64_t k = 0; k < count; k++) if (values[k] * f->root[k] < 0) return 1;
  return 0;
}

/* A way back over what has just been crossed, or is crossed next, has to wait: it would be crossed once more. */
int fmu_loops_return(fmu *f) {
  const size_t size = (size_t)f->model->states * sizeof(double);
  if (f->now.drifted == IS_CLOSED) return FMU_GOOD;
  const int waits = f->now.drifted == MAY_WAIT && fmu_roots(f) && !fmu_indicators(f, f->now.time, f->x, f->root);
  memcpy(f->loop_before, f->x, size);
  if (lmoc_land(&f->closures, f->now.time, f->x)) return fmu_refused(f, "the loops cannot be closed here");
  if (waits && crosses(f)) {
    memcpy(f->x, f->loop_before, size);
    fmu_changed(f);
    return FMU_GOOD;
  }
  if (lmoc_look(&f->closures, f->now.time, f->x, 1)) return fmu_loops_depend(f);
  stay(f);
  f->now.drifted = IS_CLOSED;
  f->now.jumped = 1;
  fmu_changed(f);
  return FMU_GOOD;
}
