/* What happens where a piece of a page's run has ended: the laws go first, then the discrete equations, and the laws again
   where those have changed something that they depend on. The host is told of each. */

#include "page_scene.h"

/* ------------------------------------------------------------------ laws and discrete equations */

/* Exchange the discrete values for those that are kept. */
static void swap(lmoc_page *p) {
  const lmoc_instant *e = &p->events.instant;
  for (int64_t i = 0; i < e->discrete; i++) {
    const double kept = p->events.past[i];
    p->events.past[i] = e->v[e->own[i]];
    e->v[e->own[i]] = kept;
  }
  p->switched = 1;
}

static void keep(lmoc_page *p) {
  const lmoc_instant *e = &p->events.instant;
  for (int64_t i = 0; i < e->discrete; i++) p->events.past[i] = e->v[e->own[i]];
}

static int renew(void *owner) {
  swap(owner);
  return 0;
}

static int happened(void *owner) {
  lmoc_page_hold(owner);
  lmoc_host_laws();
  return 0;
}

static int settle(void *owner, double time, double *x) {
  lmoc_page *p = owner;
  keep(p);
  memcpy(p->answer, x, p->n * sizeof(double));
  const int found = lmoc_page_events_settle(p, time);
  memcpy(x, p->x, p->n * sizeof(double));
  swap(p);
  return found;
}

void lmoc_page_left(lmoc_page *p) {
  keep(p);
  memcpy(p->events.left, p->x, p->n * sizeof(double));
}

int lmoc_page_settle(lmoc_page *p, double time) {
  const lmoc_discrete discrete = {p, renew, happened, settle};
  page_events *v = &p->events;
  p->instant = time;
  memcpy(v->state, p->x, p->n * sizeof(double));
  swap(p);
  const int found = lmoc_law_settle(&p->laws.run, &discrete, time, v->left, v->state);
  memcpy(p->answer, v->state, p->n * sizeof(double));
  lmoc_page_hold(p);
  return found;
}

/* ------------------------------------------------------------------ the end of a piece */

/* By what the place of a root may be wrong: some units of the time's last digit, and of a sum of steps. */
static double located(double time, double begin) {
  return 1e-14 * fmax(fabs(time), fabs(begin)) + 1e-12 * (time - begin);
}

/* Whether roots have ended the piece, with those that follow it more closely than their places are known: whether a state
   reaches a level an ulp before the tick of a clock, or behind it, is rounding. */
static int together(lmoc_page *p, double begin, int root, int stepped) {
  const int64_t count = p->finder.count, n = p->n;
  const double next = p->events.instant.owner && !stepped ? p->events.next : INFINITY;
  const double t = root && fabs(next - p->instant) <= located(p->instant, begin) ? next : p->instant, ahead = located(t, begin);
  double *x = p->place, *now = p->now;
  p->instant = t;
  if (!root) memset(p->finder.which, 0, (size_t)count);
  if (!count || !n || !(t > fmax(p->reached, begin))) return root;
  memcpy(x, p->x, n * sizeof(double));
  lmoc_page_rates(p, t);
  for (int64_t j = 0; j < n; j++) x[n + j] = x[j] + ahead * p->answer[j];
  memcpy(p->x, x, n * sizeof(double));
  memcpy(now, lmoc_page_root_values(p, t), (size_t)count * sizeof(double));
  memcpy(p->x, x + n, n * sizeof(double));
  const double *then = lmoc_page_root_values(p, t + ahead);
  for (int64_t k = 0; k < count; k++) {
    const double side = p->sides[k];
    if (p->finder.which[k] || !(side * then[k] < 0 && side * then[k] < side * now[k])) continue;
    p->finder.which[k] = 1;
    root = 1;
  }
  memcpy(p->x, x, n * sizeof(double));
  return root;
}

/* Tell the instant which functions cross zero. */
static void cross(lmoc_page *p, const uint8_t *which) {
  const lmoc_instant *e = &p->events.instant;
  const uint8_t *upper = which + e->zeros;
  for (int64_t k = 0; k < e->zeros; k++) p->events.way.which[k] = lmoc_rounded(e, k) && *upper++ ? 2 : which[k] != 0;
}

int lmoc_page_after(lmoc_page *p, double ended, double begin, int root) {
  page_events *v = &p->events;
  const int64_t roots = p->law_roots;
  const uint8_t *which = p->finder.which;
  int some = 0, found;
  const int stepped = lmoc_page_steps_at(p, ended);
  p->instant = stepped ? lmoc_page_next_step(p) : ended; /* integrators stop a few digits before */
  root = together(p, begin, root, stepped);
  const double time = p->reached = p->instant;
  if (stepped) {
    lmoc_host_steps(lmoc_page_input_steps(p, time));
    memcpy(p->x, p->answer, p->n * sizeof(double));
  }
  for (int64_t k = 0; k < roots; k++) some |= which[k];
  if (p->laws.run.k.laws.count && (some || stepped)) {
    if ((found = lmoc_page_laws_at(p, time, which, stepped))) return found;
    lmoc_host_laws();
    memcpy(p->x, p->answer, p->n * sizeof(double));
  }
  v->way.errors = root && !some && !stepped && v->instant.owner ? v->errors : 0;
  if (v->way.errors) lmoc_page_allowed(p, v->errors);
  memcpy(p->answer, p->x, p->n * sizeof(double));
  if (!v->instant.owner) return root || stepped ? 0 : LMOC_OVER;
  if (p->laws.run.k.laws.count) lmoc_page_left(p);
  if (root) cross(p, which + roots);
  if (stepped && !root) lmoc_page_events_settle(p, time); /* the end is an instant of its own */
  else if (lmoc_page_events_after(p, time, root) == LMOC_OVER) return LMOC_OVER;
  return p->laws.run.k.laws.count ? lmoc_page_settle(p, time) : 0;
}

double lmoc_page_instant(const lmoc_page *p) { return p->instant; }
