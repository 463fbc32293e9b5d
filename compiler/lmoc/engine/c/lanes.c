/* Many runs of one scene, each with its own parameters, start, tolerances and lengths of steps; along series as many at a
   time as there are lanes. The steps are those of `walk.c` and `taylor.c`, in the order in which `steps/loop.py` has them
   made. */

#include "taylor.h"
#include "walk.h"

/* Why a leg has ended, besides what a step has: so many steps were allowed; there were so many that it has to be looked
   at in Python whether they get on. */
enum { ENOUGH = 5, UNSEEN = 6 };

/* A part of a run with one method and one tolerance. */
typedef struct {
  double time, rtol, step;        /* where it stands; the first step, or infinity; then the next one */
  double shortest;                /* mean length of steps below which a series gives up, s */
  int64_t most, overrun;          /* steps and rejected ones; more of them where they are expected to reach the end */
  int64_t reached, steps, rejected, found;
} leg;

typedef struct {
  lmoc_call *call;
  int64_t registers, blocks, start_blocks; /* parameters of a run; blocks of the tape, and of that of a series */
  const double *base;             /* (lanes, registers) */
  double *x;                      /* (lanes, n) the state where it stands */
  const double *atol;             /* (lanes, n) */
  leg *legs;
  double end, longest, patience;
  int64_t goes_on;                /* whether what follows is about the lane of the last call */
  int64_t seen;                   /* steps up to which nobody looks whether they get on */
  const double *times;
  int64_t outputs;
  double *out;                    /* (outputs, n) of each run … */
  int64_t apart;                  /* … so far apart */
  lmoc_steps *steps;              /* DOP853; or 0 */
  const lmoc_taylor *taylor;      /* series; or 0 */
  double *memory;                 /* of series, (2*n*(LENGTH + 1) + n, lanes); of DOP853, (lanes, 27*n) */
} lanes;

/* A run at its beginning in a lane; one that goes on alone has its registers and its order of pivots still. */
static void prepare(const lanes *l, int64_t run, int64_t lane) {
  if (l->goes_on) return;
  const double *base = l->base + run*l->registers;
  for (int64_t k = 0; k < l->registers; k++) l->call->w[LMOC_AT(k) + lane] = base[k];
  lmoc_forget(l->call->tape, l->blocks);
  l->call->solved = l->call->marked = 0;
  if (l->taylor) lmoc_forget(l->taylor->series->start, l->start_blocks);
}

/* Steps that may still be made; 0 at the end, and where there are to be no more: `found` says why. */
static int64_t left(const lanes *l, leg *g, double begin, int64_t *allowed) {
  while (!g->found && g->time < l->end) {
    const int64_t done = g->steps + g->rejected;
    if (done >= l->seen) g->found = UNSEEN;
    else if (done < *allowed) return *allowed < l->seen ? *allowed - done : l->seen - done;
    else if (*allowed > g->most || !((double)g->steps*(l->end - g->time) < (double)g->overrun*(g->time - begin)))
      g->found = ENOUGH;
    else *allowed += g->overrun;
  }
  return 0;
}

/* What is under way in one lane. */
typedef struct {
  int64_t run;  /* or -1 */
  double begin;
  int64_t allowed;
} lane;

/* Have a lane go on with its run. Returns 0 where that is over. */
static int go_on(const lanes *l, lmoc_walk *s, int64_t k, lane *own) {
  leg *g = l->legs + own->run;
  lmoc_walk_afresh(s, k);
  s->made[k] = g->steps;
  s->most[k] = left(l, g, own->begin, &own->allowed);
  s->times[k] = l->times + g->reached;
  s->outputs[k] = s->room[k] = l->outputs - g->reached;
  s->out[k] = l->out + own->run*l->apart + g->reached*l->call->n;
  return s->most[k] > 0;
}

static void begin(const lanes *l, lmoc_walk *s, int64_t k, lane *own, double *atol) {
  const int64_t n = l->call->n;
  const leg *g = l->legs + own->run;
  prepare(l, own->run, k);
  s->time[k] = s->before[k] = g->time;
  s->rtol[k] = g->rtol;
  s->length[k] = g->step;
  s->begun[k] = g->time;
  s->shortest[k] = g->shortest;
  s->begins[k] = 1;
  for (int64_t i = 0; i < n; i++) {
    s->next[LMOC_AT(i*LMOC_LENGTH) + k] = l->x[own->run*n + i];
    atol[LMOC_AT(i) + k] = l->atol[own->run*n + i];
  }
  own->begin = g->time;
  own->allowed = g->most;
}

/* Take what a lane that has stopped has found. */
static void arrive(const lanes *l, const lmoc_walk *s, int64_t k, const lane *own) {
  leg *g = l->legs + own->run;
  const int64_t n = l->call->n;
  g->found = s->found[k];
  g->steps += s->steps[k];
  g->rejected += s->tries[k] - s->steps[k];
  g->reached += s->reached[k];
  g->time = s->time[k];
  g->step = s->length[k];
  for (int64_t i = 0; i < n; i++) l->x[own->run*n + i] = s->x[LMOC_AT(i) + k];
}

/* As soon as a lane is free the next run begins in it. */
static void along_series(const lanes *l, int64_t count, const int64_t *which) {
  const int64_t n = LMOC_AT(l->call->n);
  double *m = l->memory, *atol = m + 2*n*LMOC_LENGTH + 2*n;
  lmoc_walk s = {.end = l->end, .longest = l->longest, .atol = atol, .q = m, .next = m + n*LMOC_LENGTH,
                 .x = m + 2*n*LMOC_LENGTH, .between = m + 2*n*LMOC_LENGTH + n};
  lane own[LMOC_LANES] = {{0}};
  int64_t stopped = ((int64_t)1 << LMOC_LANES) - 1, busy = 0;
  for (int64_t k = 0; k < LMOC_LANES; k++) own[k].run = -1;
  do {
    for (int64_t k = 0; k < LMOC_LANES; k++) {
      if (!((stopped >> k) & 1)) continue;
      if (own[k].run >= 0) {
        arrive(l, &s, k, own + k);
        if (go_on(l, &s, k, own + k)) continue;
        busy--;
      }
      for (own[k].run = -1, s.most[k] = 0; count > 0 && s.most[k] <= 0; count--) {
        own[k].run = *which++;
        begin(l, &s, k, own + k, atol);
        busy += go_on(l, &s, k, own + k);
      }
      if (s.most[k] <= 0) own[k].run = -1;
    }
    stopped = busy ? LMOC_NAME(lmoc_taylor_go)(l->taylor, &s) : 0;
  } while (busy);
}

#define SOME(of) for (int64_t k = 0; k < LMOC_LANES; k++) if (((of) >> k) & 1)

/* A run with DOP853 in a lane. */
typedef struct {
  lane own;
  lmoc_steps s;
} stepped;

/* f at a time and a place of each of some lanes. */
static void derivatives(const lanes *l, int64_t some, const double *time, double *const *x, double *const *f) {
  lmoc_call *c = l->call;
#if !LMOC_OF_LANES
  if (some) lmoc_derivatives(c, time[0], x[0], f[0]);
#else
  const int64_t n = c->n;
  SOME(some) for (int64_t i = 0; i < n; i++) c->w[LMOC_AT(c->states[i]) + k] = x[k][i];
  const int failed = c->tape->run(time, c->w, c->tape);
  SOME(some)
    for (int64_t i = 0; i < n; i++) f[k][i] = (failed >> k) & 1 ? NAN : c->w[LMOC_AT(c->derivatives[i]) + k];
#endif
}

/* Stages of the steps that some lanes try or have made, from where these begin. */
static void stages(const lanes *l, stepped *own, int64_t some, int first, int last) {
  const int64_t n = l->call->n;
  double time[LMOC_LANES] = {0}, *x[LMOC_LANES], *f[LMOC_LANES];
  for (int stage = first; some && stage <= last; stage++) {
    SOME(some) {
      lmoc_steps *s = &own[k].s;
      const double begin = s->pending ? s->before : s->t, h = s->pending ? s->length : s->trial;
      x[k] = stage == 12 ? s->x_new : s->last;
      f[k] = s->k + stage*n;
      time[k] = stage == 12 ? begin + h : begin + s->nodes[stage]*h;
      lmoc_dop853_stage(n, stage, s->weights + 16*(stage == 12 ? 16 : stage), h, s->x, s->k, x[k]);
    }
    derivatives(l, some, time, x, f);
  }
}

/* Choose the first steps of lanes that begin; returns those whose f is no number. */
static int64_t first_steps(const lanes *l, stepped *own, int64_t some) {
  const int64_t n = l->call->n;
  double time[LMOC_LANES] = {0}, *x[LMOC_LANES], *f[LMOC_LANES];
  int64_t lost = 0, open = 0;
  SOME(some) {
    time[k] = own[k].s.t;
    x[k] = own[k].s.x;
    f[k] = own[k].s.f;
  }
  if (some) derivatives(l, some, time, x, f);
  SOME(some) {
    lmoc_steps *s = &own[k].s;
    double check = 0;
    for (int64_t i = 0; i < n; i++) check += s->f[i] * 0;
    if (check != 0) lost |= (int64_t)1 << k;
    else if (!(s->step_size < INFINITY)) {
      open |= (int64_t)1 << k;
      s->step_size = lmoc_first_trial(n, s->end - s->t, s->max_step, lmoc_dop853_least(s), s->rtol, s->atol, s->x,
                                      s->f);
      for (int64_t i = 0; i < n; i++) s->x_new[i] = s->x[i] + s->step_size*s->f[i];
      time[k] = s->t + s->step_size;
      x[k] = s->x_new;
      f[k] = s->k;
    }
  }
  if (open) derivatives(l, open, time, x, f);
  SOME(open) {
    lmoc_steps *s = &own[k].s;
    s->step_size = lmoc_first_step(n, s->step_size, s->end - s->t, s->rtol, s->atol, s->x, s->f, s->k);
  }
  return lost;
}

static void set_out(const lanes *l, int64_t k, stepped *own) {
  const int64_t n = l->call->n;
  const leg *g = l->legs + own->own.run;
  lmoc_steps *s = &own->s;
  double *m = l->memory + 27*n*k;
  prepare(l, own->own.run, k);
  *s = (lmoc_steps){.call = l->call, .rules = l->steps->rules, .weights = l->steps->weights, .nodes = l->steps->nodes,
                    .dense = l->steps->dense, .omitted = l->steps->omitted, .atol = l->atol + own->own.run*n,
                    .x = m, .f = m + n, .x_new = m + 2*n, .last = m + 3*n, .k = m + 4*n, .terms = m + 20*n,
                    .t = g->time, .before = g->time, .cuts_since = g->time, .step_size = g->step,
                    .grow = l->steps->rules->grow, .rtol = g->rtol, .end = l->end, .max_step = l->longest,
                    .patience = l->patience};
  memcpy(s->x, l->x + own->own.run*n, n * sizeof(double));
  own->own.begin = g->time;
  own->own.allowed = g->most;
}

/* Take what a walk has found, and have it go on as far as it may. Returns 0 where it is over. */
static int walked(const lanes *l, stepped *own, int found) {
  leg *g = l->legs + own->own.run;
  const int64_t n = l->call->n;
  lmoc_steps *s = &own->s;
  g->found = found;
  g->steps += s->steps;
  g->rejected += s->rejected;
  g->reached += s->reached;
  g->time = s->t;
  g->step = s->step_size;
  lmoc_dop853_afresh(s);
  s->most = left(l, g, own->own.begin, &own->own.allowed);
  s->times = l->times + g->reached;
  s->outputs = s->room = l->outputs - g->reached;
  s->out = l->out + own->own.run*l->apart + g->reached*n;
  if (s->most > 0) return 1;
  memcpy(l->x + own->own.run*n, s->pending ? s->x_new : s->x, n * sizeof(double));
  return 0;
}

/* Have a lane propose its next step. Returns 0 where its run is over. */
static int proposes(const lanes *l, stepped *own, int judged) {
  int found = judged == LMOC_AGAIN ? 0 : lmoc_dop853_choose(&own->s);
  if (!found) found = lmoc_dop853_propose(&own->s);
  return !found || walked(l, own, found);
}

/* Judge the steps that lanes have tried. */
static void judge(const lanes *l, stepped *own, int64_t going, int *judged) {
  int64_t rough = 0;
  SOME(going) {
    lmoc_steps *s = &own[k].s;
    double result[2];
    lmoc_dop853_errors(l->call->n, s->trial, s->rtol, s->weights, s->x, s->atol, s->k, s->x_new, s->last, result);
    judged[k] = lmoc_dop853_judge(s, result);
    if (judged[k] == LMOC_ROUGH) rough |= (int64_t)1 << k;
  }
  stages(l, own, rough, 13, 15);
  SOME(rough) {
    own[k].s.staged = 1;
    judged[k] = lmoc_dop853_judge_within(&own[k].s);
  }
}

/* Take what is good of the steps that lanes have tried, with its output. Returns those that go on, with the next one. */
static int64_t taken(const lanes *l, stepped *own, int64_t going, const int *judged) {
  int64_t shows = 0, further = 0;
  int found[LMOC_LANES] = {0};
  SOME(going) {
    if (judged[k] == LMOC_AGAIN) continue;
    found[k] = lmoc_dop853_accept(&own[k].s);
    if (lmoc_dop853_shows(&own[k].s) && !own[k].s.staged) shows |= (int64_t)1 << k;
  }
  stages(l, own, shows, 13, 15);
  SOME(shows) own[k].s.staged = 1;
  SOME(going) {
    const int ends = judged[k] != LMOC_AGAIN && (lmoc_dop853_arrive(&own[k].s) || found[k]);
    if ((!ends || walked(l, own + k, found[k])) && proposes(l, own + k, judged[k])) further |= (int64_t)1 << k;
  }
  return further;
}

/* As soon as a lane is free the next run begins in it. */
static void with_dop853(const lanes *l, int64_t count, const int64_t *which) {
  stepped own[LMOC_LANES];
  int64_t going = 0;
  int judged[LMOC_LANES];
  memset(own, 0, sizeof own);
  do {
    int64_t fresh = 0;
    SOME(~going) {
      if (count-- <= 0) break;
      own[k].own.run = *which++;
      set_out(l, k, own + k);
      fresh |= (int64_t)1 << k;
    }
    const int64_t lost = first_steps(l, own, fresh);
    SOME(fresh)
      if (walked(l, own + k, (lost >> k) & 1 ? LMOC_LOST : 0) && proposes(l, own + k, LMOC_GOOD))
        going |= (int64_t)1 << k;
    stages(l, own, going, 1, 12);
    judge(l, own, going, judged);
    going = taken(l, own, going, judged);
  } while (going || count > 0);
}

/* Go on with some of the runs, each to where its leg ends. */
void LMOC_NAME(lmoc_lanes_walk)(const lanes *l, int64_t count, const int64_t *which) {
  for (int64_t k = 0; k < count; k++) {
    leg *g = l->legs + which[k];
    g->steps = g->rejected = g->found = 0;
  }
  if (l->taylor) along_series(l, count, which);
  else with_dop853(l, count, which);
}

#if !LMOC_OF_LANES

/* Central differences of f by the states where some of the lanes stand, with these shifts (count, n), into
   (count, n, n). */
void lmoc_lanes_differences(const lanes *l, int64_t count, const int64_t *which, const double *shift, double *out) {
  const int64_t n = l->call->n;
  double *x = l->steps->x_new, *low = l->steps->k, *high = low + n;
  for (int64_t k = 0; k < count; k++) {
    const double time = l->legs[which[k]].time, *own = shift + k*n;
    double *jacobian = out + k*n*n;
    prepare(l, which[k], 0);
    memcpy(x, l->x + which[k]*n, n * sizeof(double));
    for (int64_t j = 0; j < n; j++) {
      const double at = x[j];
      x[j] = at - own[j];
      lmoc_derivatives(l->call, time, x, low);
      x[j] = at + own[j];
      lmoc_derivatives(l->call, time, x, high);
      x[j] = at;
      for (int64_t i = 0; i < n; i++) jacobian[i*n + j] = (high[i] - low[i]) / (2*own[j]);
    }
    lmoc_derivatives(l->call, time, x, low);  /* blocks go on from here */
  }
}

#endif
