/* Many runs of one scene, each with its own parameters, start, tolerances and lengths of steps; along series as many at a
   time as there are lanes. The steps are those of `walk.c` and `taylor.c`, in the order in which `steps/loop.py` has them
   made. */

#include "abreast.h"
#include "taylor.h"

/* Why a leg has ended, besides what a step has: so many steps were allowed; there were so many that it has to be looked
   at in Python whether they get on. */
enum { ENOUGH = 5, UNSEEN = 6 };

/* A part of a run with one method and one tolerance. */
typedef struct {
  double time, rtol, step;        /* where it stands; the first step, or infinity; then the next one */
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
  double *memory;                 /* of series, (2*n*(LENGTH + 1) + n, lanes) */
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

#if !LMOC_OF_LANES

static void with_dop853(const lanes *l, int64_t lane) {
  const int64_t n = l->call->n;
  lmoc_steps *s = l->steps;
  leg *g = l->legs + lane;
  double *x = l->x + lane*n;
  prepare(l, lane, 0);
  memcpy(s->x, x, n * sizeof(double));
  s->atol = l->atol + lane*n;
  s->rtol = g->rtol;
  s->end = l->end;
  s->max_step = l->longest;
  s->patience = l->patience;
  s->t = g->time;
  if (!lmoc_dop853_begin(s, g->step)) {
    g->found = LMOC_LOST;
    return;
  }
  const double begin = g->time;
  int64_t allowed = g->most;
  while ((s->most = left(l, g, begin, &allowed)) > 0) {
    s->times = l->times + g->reached;
    s->outputs = s->room = l->outputs - g->reached;
    s->out = l->out + lane*l->apart + g->reached*n;
    g->found = lmoc_dop853_walk(s);
    g->steps += s->steps;
    g->rejected += s->rejected;
    g->reached += s->reached;
    g->time = s->t;
  }
  g->step = s->step_size;
  memcpy(x, s->pending ? s->x_new : s->x, n * sizeof(double));
}

#endif

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

/* Go on with some of the runs, each to where its leg ends. */
void LMOC_NAME(lmoc_lanes_walk)(const lanes *l, int64_t count, const int64_t *which) {
  for (int64_t k = 0; k < count; k++) {
    leg *g = l->legs + which[k];
    g->steps = g->rejected = g->found = 0;
  }
  if (l->taylor) along_series(l, count, which);
#if !LMOC_OF_LANES
  else for (int64_t k = 0; k < count; k++) with_dop853(l, which[k]);
#endif
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
