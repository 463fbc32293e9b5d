/* Low hops in Model Exchange: what bounces on the scale of the other tool's errors comes back when those say so, and not
   at all where its steps are longer. An instance foresees by its own steps when such a hop ends, tells that time as an
   event, and puts the states there that it has foreseen. What is set from outside meanwhile takes the foresight back. */

#include "fmu_laws.h"

#include <stdlib.h>

static const double LOW = 1e5;      /* errors that the other tool may allow itself, below which a hop is low: an error d of
                                       a gap changes the speed at which it closes by d/(2 height) of it, for all hops to come */
static const double OFF = 1e3;      /* times the same errors, by which states may be off at its end */
static const double AROUND = 10;    /* times its height, by which a step of order one over the hop may be off */
static const double FINER = 1e-5;   /* share of the tolerance with which an instance foresees … */
static const double FINEST = 1e-12; /* … but no finer than that */
static const double MARGIN = 2;     /* times the hop, in which it has to end */
enum { STEPS = 300 };                /* in which it has to be foreseen: no stiff motion by an explicit method */
static const double ULPS = 16 * 0x1p-52; /* of the time: no tool makes a step so short */

/* What has been foreseen, in one piece of memory: states, what those of the other tool may be off, the functions that
   vanish there, and the room of `hops`. */
int64_t fmu_hop_room(const fmu_model *m, int64_t roots) { return 2*m->states + roots + m->laws.laws.count; }

static double *room_of(const fmu *f, double *foresight) { return foresight + 2*f->model->states + fmu_roots(f); }

/* The laws that are on a low hop, or on one that the other tool makes a step over: `room` (n,) is what their gaps may be
   off there, else 0. Returns how long the longest takes. */
static double hops(fmu *f, double *room) {
  lmoc_law_run *s = &f->laws;
  const lmoc_contact *at = &s->spare;
  const int64_t n = s->k.laws.count, states = s->k.states;
  double longest = 0;
  fmu_law_given(f);
  if (lmoc_contact_at(&s->k, f->now.time, f->x, &s->spare)) return 0;
  for (int64_t i = 0; i < n; i++) {
    const int hops = !s->closed[i] && !s->implied[i] && s->k.unilateral[i] && s->left[i] > 0 && s->level[i] < 0;
    const double rate = at->rate[i], down = -s->level[i], gap = fmax(at->gap[i], 0);
    const double height = gap + (rate > 0 ? rate * rate / (2 * down) : 0);
    double errors = 0;
    for (int64_t j = 0; j < states && hops; j++) errors += fabs(at->slope[i*states + j]) * f->errors[j];
    room[i] = 0;
    if (!hops || !(height <= LOW * errors || s->idle[i] > 0)) continue;
    room[i] = AROUND * height + OFF * errors;
    longest = fmax(longest, (rate + sqrt(rate * rate + 2 * gap * down)) / down);
  }
  return longest;
}

static void unheard(void *own, const char *text) { (void)own, (void)text; }

/* Go on from here until something happens, and keep that; infinity where nothing does by then. */
static double look_ahead(fmu *f, double until, double *x, double *off, double *which) {
  const double from = f->now.time;
  const fmu_tell tell = f->tell;
  int root = 0, found;
  f->tell = unheard; /* of a place to which the motion need not lead */
  found = fmu_evaluate(f);
  for (int64_t j = 0; j < f->model->states; j++) off[j] = fabs(f->w[RIGHT][f->model->derivative[j]]);
  f->now.wish = 0;
  f->now.rtol = fmax(FINER * f->now.rtol, FINEST);
  f->patience = STEPS;
  if (!found) found = fmu_smooth(f, until, &root);
  f->patience = INT64_MAX;
  f->tell = tell;
  if (found || !root || !(f->now.time - from > ULPS * fabs(f->now.time))) return INFINITY;
  for (int64_t j = 0; j < f->model->states; j++) {
    x[j] = f->x[j];
    off[j] = off[j] * (f->now.time - from) + OFF * f->errors[j];
  }
  for (int64_t k = 0; k < fmu_roots(f); k++) which[k] = f->finder.which[k];
  return f->now.time;
}

/* At the end of an event: when low hops end. */
static int foresee(fmu *f) {
  double *x = f->ahead, *off = x + f->model->states, *which = off + f->model->states;
  const double longest = hops(f, room_of(f, f->ahead));
  if (f->now.ended || !(longest > 0)) return FMU_GOOD;
  const size_t size = fmu_bytes(f);
  unsigned char *kept = malloc(size);
  if (!kept) return fmu_refused(f, "there is no memory to foresee the end of a hop");
  fmu_save(f, kept);
  const double time = look_ahead(f, fmin(f->now.time + MARGIN * longest, fmu_next(f)), x, off, which);
  const int found = fmu_restore(f, kept, size);
  free(kept);
  f->now.foreseen = time;
  f->now.surprised = !(time < INFINITY);
  memcpy(f->foresight, f->ahead, (size_t)fmu_hop_room(f->model, fmu_roots(f)) * sizeof(double));
  return found;
}

void fmu_surprise(fmu *f) {
  f->now.surprised |= f->now.foreseen < INFINITY;
  f->now.foreseen = INFINITY;
}

/* Whether the time has come that has been foreseen, and the other tool has come to that place. */
static int has_come(fmu *f) {
  const int64_t n = f->model->states;
  const double *x = f->foresight, *off = x + n;
  int near = f->now.foreseen < INFINITY && fabs(f->now.time - f->now.foreseen) <= ULPS * fabs(f->now.time);
  for (int64_t j = 0; j < n; j++) near &= fabs(f->x[j] - x[j]) <= off[j];
  return near;
}

int fmu_event(fmu *f) {
  const int64_t n = f->model->states;
  const int came = has_come(f);
  if (!came && f->now.foreseen <= f->now.time) fmu_surprise(f);
  if (came) {
    memcpy(f->x, f->foresight, (size_t)n * sizeof(double));
    for (int64_t k = 0; k < fmu_roots(f); k++) f->finder.which[k] = f->foresight[2*n + k] != 0;
    f->now.surprised = 0;
    fmu_changed(f);
  }
  f->now.foreseen = INFINITY;
  f->located = came;
  const int found = fmu_happen(f);
  f->located = 0;
  f->now.jumped |= came;
  return found || !f->model->laws.laws.count ? found : foresee(f);
}

void fmu_hop_indicators(const fmu *f, double *laws) {
  const double *room = room_of(f, f->foresight);
  for (int64_t i = 0; i < f->model->laws.laws.count && f->now.foreseen < INFINITY; i++) laws[i] += room[i];
}
