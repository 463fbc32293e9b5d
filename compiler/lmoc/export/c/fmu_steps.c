/* Steps of an instance of an FMU: those of Co-Simulation, and what is to be said of a step that another side has made. */

#include "fmu_laws.h"
#include "fmu_loops.h"

#include <stdio.h>

static const double SHORTEST = 8e-16; /* share of the time, up to which DOP853 has no step (`engine/c/walk.c`) */
enum { STANDING = 1000 };             /* events in a row between which the time does not go on */

/* An instance and the step that it makes: what `look`, `land` and `keep` are about. */
typedef struct {
  fmu *f;
  const lmoc_steps *s;
  int turned; /* whether a loop has turned farther in the last look than can be judged */
} walk;

static int look(void *own, double time, const double *x, int first) {
  walk *w = own;
  (void)first;
  w->turned = !fmu_branches_follow(w->f, w->s);
  return w->turned || !fmu_branches_stand(w->f) || (w->f->model->loops.stages && fmu_loops_look(w->f, time, x));
}

/* Onto the closures of loops, and onto what laws keep closed. */
static int land(void *own, double time, double *x) {
  fmu *f = ((walk *)own)->f;
  if (f->model->loops.stages && fmu_loops_land(f, time, x)) return 1;
  return lmoc_law_drifts(&f->laws) ? fmu_law_keep(f, time, x) : 0;
}

static void keep(void *own) {
  fmu *f = ((walk *)own)->f;
  lmoc_mark(&f->call);
  if (f->model->loops.stages) fmu_loops_keep(f);
}

int fmu_accept(fmu *f) {
  const int found = fmu_evaluate(f);
  int looked;
  if (found) return found;
  if (!fmu_branches_stand(f)) {
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

double fmu_next(const fmu *f) { return fmin(fmin(fmu_next_break(f), f->now.next), f->now.foreseen); }

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
static int again(walk *own, lmoc_steps *s, int status) {
  fmu *f = own->f;
  if (status != LMOC_DOUBTFUL || !(own->turned || f->model->loops.stages)) return 0;
  own->turned = 0;
  if (f->call.marked) lmoc_go_back(&f->call);
  s->step_size = s->length / 4;
  s->grow = 1;
  return 1;
}

int fmu_smooth(fmu *f, double end, int *root) {
  const fmu_model *m = f->model;
  const int64_t n = m->states;
  double *at = f->work, *k = at, *slope = k + 16*n, *x_new = slope + n, *last = x_new + n, *terms = last + n,
         *landed = terms + 7*n, *atol = landed + n, *begin = atol + n;
  const int found = fmu_derivatives(f, slope), watched = fmu_roots(f) > 0;
  if (found) return found;
  if (m->branches) { /* the branch on which the first step begins */
    lmoc_evaluate(&f->call, f->now.time, f->x);
    lmoc_mark(&f->call);
  }
  for (int64_t i = 0; i < n; i++) atol[i] = tolerance(f) * 1e-3 * m->nominal[i];
  if (!(f->now.wish > 0)) f->now.wish = first_step(f, end - f->now.time, slope, atol, x_new, last);
  walk own = {f, 0, 0};
  const lmoc_step_hook hook = {&own, look, m->loops.stages || lmoc_law_drifts(&f->laws) ? land : 0, keep, 0};
  lmoc_steps s = {.call = &f->call, .rules = &m->rules, .weights = m->weights, .nodes = m->nodes, .dense = m->dense,
                  .omitted = m->omitted, .atol = atol, .x = f->x, .f = slope, .x_new = x_new, .k = k, .last = last,
                  .terms = terms, .landed = landed, .t = f->now.time, .before = f->now.time, .step_size = f->now.wish,
                  .grow = m->rules.grow, .cuts_since = f->now.time, .rtol = tolerance(f), .end = end,
                  .max_step = m->events.longest, .patience = INFINITY, .most = watched ? 1 : INT64_MAX, .hook = &hook};
  int status = 0, shorter, doubted = 0;
  int64_t left = f->patience;
  own.s = &s;
  do {
    const double wished = s.step_size;
    memcpy(begin, f->x, n * sizeof(double));
    status = lmoc_dop853_walk(&s);
    const int cut = s.steps == 1 && !s.rejected && s.length < wished; /* at the end: no shorter */
    shorter = again(&own, &s, status);
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
  } while (shorter || (watched && !status && !*root && s.t < end && --left > 0));
  f->now.time = s.t;
  fmu_changed(f);
  if (!status || *root) return FMU_GOOD;
  if (doubted && m->loops.stages) return fmu_loops_depend(f);
  if (doubted || status == LMOC_DOUBTFUL)
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
  int found = fmu_evaluate(f), standing = 0;
  if (found) return found;
  if (fmu_passed(f) && happen(f, &found)) return found; /* inputs and parameters may have been set */
  while (f->now.time < end) {
    const double jump = fmu_next_break(f), next = fmin(fmu_next(f), end);
    /* the last stage of a step before a jump must not see what comes behind it */
    const double until = jump <= next ? next - 4e-16*fabs(next) : next, from = f->now.time;
    int root = 0;
    if (until - f->now.time > SHORTEST * fabs(until)) { /* an ulp is no step: a tick just before a communication point */
      found = f->model->states ? fmu_smooth(f, until, &root) : pass_time(f, until, &root);
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
  return fmu_evaluate(f);
}
