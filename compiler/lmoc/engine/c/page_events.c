/* The events of a scene of a page: what the iteration of `instant.c` asks, and its memory. */

#include "page_scene.h"

#include <stdlib.h>

/* ------------------------------------------------------------------ what is asked */

static int evaluated(lmoc_page *p, int64_t program, double time, const double *x) {
  memmove(p->x, x, p->n * sizeof(double));
  return lmoc_page_evaluate(p, (int)program, time) & LMOC_FAILED ? LMOC_NO_VALUE : LMOC_SETTLED;
}

static int look(lmoc_instant *e, double time, const double *x) {
  lmoc_page *p = e->owner;
  const int lost = evaluated(p, p->events.look, time, x);
  for (int64_t k = 0; k < e->zeros; k++) e->zero[k] = p->w[p->events.zero[k]];
  return lost;
}

static int widen(lmoc_instant *e, double time, const double *x) {
  return lmoc_widen_beside(e, time, x, ((lmoc_page *)e->owner)->events.work);
}

static double seen(lmoc_instant *e, const double *x, int64_t reinit) {
  const lmoc_page *p = e->owner;
  return look(e, e->time, x) ? NAN : p->w[p->events.seen[reinit]];
}

static int move(lmoc_instant *e, const double *x, int64_t reinit, double wanted, double *moved) {
  lmoc_page *p = e->owner;
  return lmoc_move_one(e, seen, x, reinit, wanted, moved, p->events.work) != LMOC_MOVED;
}

/* The motion with the present discrete values, which `hops.c` looks along. */
static int motion(lmoc_instant *e, double time, const double *x, double *rates, double *zeros) {
  lmoc_page *p = e->owner;
  const int lost = evaluated(p, p->right, time, x);
  for (int64_t i = 0; i < e->states; i++) rates[i] = lost ? NAN : p->w[p->derivatives[i]];
  const int gone = lost || look(e, time, x);
  for (int64_t k = 0; k < e->zeros; k++) zeros[k] = gone ? NAN : e->zero[k];
  return LMOC_SETTLED;
}

/* ------------------------------------------------------------------ reading */

/* The tables in the order of `lmoc_instant`, and how many there are of what. */
static void read_tables(lmoc_instant *e, lmoc_bytes *b) {
  int64_t count;
#define READ(name) e->name = lmoc_read_integers(b, &count)
  READ(own);
  e->discrete = count;
  READ(op);
  e->relations = count;
  READ(target);
  READ(row);
  READ(of_zero);
  e->zeros = count;
  READ(slope);
  READ(offset);
  READ(written);
  READ(now);
  e->before = count;
  READ(past);
  READ(held);
  READ(sample);
  e->samples = count;
  READ(start);
  READ(interval);
  READ(guard);
  e->reinits = count;
  READ(state);
  READ(value);
  READ(tell);
  e->told = count;
  READ(sought);
  READ(read);
  e->bounded = count;
  READ(filled);
  e->assigned = count;
  READ(first_used);
  READ(used);
#undef READ
}

static int make_room(page_events *v, int64_t n) {
  lmoc_instant *e = &v->instant;
  const int64_t zeros = e->zeros, d = e->discrete;
  const int64_t sum = n + 8*zeros + 2*e->relations + 2*d + LMOC_HISTORY*d + zeros*(LMOC_CHATTER + 10) + 8*n + 8;
  double *at = calloc((size_t)(sum + 3*zeros), sizeof(double));
  e->found = calloc((size_t)e->told + 1, sizeof(int64_t));
  e->near = calloc((size_t)zeros + 1, 1);
  if (!at || !e->found || !e->near) return 0;
#define TAKE(name, count) (v->name = at, at += (count))
  TAKE(instant.zero, zeros), TAKE(instant.margin, zeros), TAKE(instant.largest, zeros), TAKE(instant.high, zeros);
  TAKE(instant.supposed, e->relations), TAKE(instant.early, e->relations), TAKE(instant.changed, d);
  TAKE(instant.flipped, d), TAKE(instant.moved, n), TAKE(instant.history, LMOC_HISTORY*d);
  TAKE(hops.times, zeros*LMOC_CHATTER), TAKE(hops.home, zeros), TAKE(hops.work, 4*n + 9*zeros);
  TAKE(work, 2*n + 3*zeros), TAKE(noise, zeros), TAKE(which, zeros), TAKE(turn, zeros), TAKE(before, n), TAKE(at, zeros);
#undef TAKE
  return 1;
}

void lmoc_page_read_events(lmoc_page *p, lmoc_bytes *b) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  int64_t count;
  if (!lmoc_read_integer(b)) return;
  v->look = lmoc_read_integer(b);
  const int64_t assign = lmoc_read_integer(b), lines = lmoc_read_integer(b);
  v->zero = lmoc_read_integers(b, &count);
  v->seen = lmoc_read_integers(b, &count);
  read_tables(e, b);
  if (b->failed || v->look >= p->program_count || assign >= p->program_count || lines >= p->program_count) {
    b->failed = 1;
    return;
  }
  e->states = p->n;
  e->assign = &p->programs[assign].program.tape;
  e->lines = &p->programs[lines].program.tape;
  e->owner = p;
  e->look = look;
  e->widen = widen;
  e->others = lmoc_try_relations;
  e->move = move;
  v->hops.motion = motion;
  v->hops.step = INFINITY;
  if (!make_room(v, p->n)) b->failed = 1;
}

/* ------------------------------------------------------------------ the host */

void lmoc_page_begin_events(lmoc_page *p, double time, double span) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  for (int64_t k = 0; k < e->zeros; k++) e->margin[k] = e->largest[k] = e->high[k] = v->hops.home[k] = 0;
  for (int64_t k = 0; k < e->zeros; k++) v->hops.home[k] = -INFINITY;
  for (int64_t k = 0; k < e->zeros * LMOC_CHATTER; k++) v->hops.times[k] = -INFINITY;
  for (int64_t k = 0; k < e->relations; k++) e->early[k] = 0;
  v->hops.begin = time;
  v->hops.span = span;
  e->time = time;
  e->literal = 1;
}

void lmoc_page_literal(lmoc_page *p, int is) { p->events.instant.literal = is; }

int lmoc_page_take(lmoc_page *p, double time) {
  memcpy(p->answer, p->x, p->n * sizeof(double));
  return lmoc_take(&p->events.instant, time, p->answer);
}

void lmoc_page_remember(lmoc_page *p) { lmoc_remember(&p->events.instant); }

void lmoc_page_assign(lmoc_page *p) { lmoc_assign(&p->events.instant); }

int lmoc_page_solve(lmoc_page *p, double time) {
  p->events.instant.time = time;
  memcpy(p->answer, p->x, p->n * sizeof(double));
  return lmoc_solve_instant(&p->events.instant, p->answer);
}

int lmoc_page_reinit(lmoc_page *p, double time) {
  lmoc_instant *e = &p->events.instant;
  int some;
  e->time = time;
  memcpy(p->answer, p->x, p->n * sizeof(double));
  if (lmoc_reinit(e, p->answer, &some)) return 2;
  if (some) memcpy(p->answer, e->moved, p->n * sizeof(double));
  return some;
}

double lmoc_page_next(lmoc_page *p, double time, int include) {
  return lmoc_next_time(&p->events.instant, time, include);
}

void lmoc_page_ring(lmoc_page *p, double time) { lmoc_ring(&p->events.instant, time); }

int lmoc_page_event(lmoc_page *p) {
  p->switched = 1;
  memcpy(p->answer, p->x, p->n * sizeof(double));
  return lmoc_event(&p->events.instant, p->answer);
}

int lmoc_page_told_count(const lmoc_page *p) { return (int)p->events.instant.found_count; }

int lmoc_page_told_of(const lmoc_page *p, int k) { return (int)p->events.instant.found[k]; }

double *lmoc_page_crossing(lmoc_page *p) { return p->events.which; }

/* The first function of some. */
static int first(const lmoc_page *p, const double *which) {
  int64_t k = 0;
  while (k + 1 < p->events.instant.zeros && which[k] == 0) k++;
  return 100 + (int)k;
}

int lmoc_page_cross(lmoc_page *p, double time) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  memcpy(v->before, p->x, p->n * sizeof(double));
  const int64_t busy = lmoc_cross(e, &v->hops, time, v->which);
  if (busy >= 0) return 100 + (int)busy;
  const int found = lmoc_wrong_way(e, &v->hops, time, v->before, v->which, v->turn);
  if (found == LMOC_TOO_LOW) return first(p, v->turn);
  if (lmoc_take(e, time, v->before)) return LMOC_NO_VALUE;
  memcpy(v->at, e->zero, e->zeros * sizeof(double));
  return LMOC_SETTLED;
}

int lmoc_page_turned_back(lmoc_page *p, double time) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  int some = 0;
  memcpy(p->answer, p->x, p->n * sizeof(double));
  const int found = lmoc_turned_back(e, &v->hops, time, v->before, p->answer, v->which, v->at, v->turn);
  if (found == LMOC_TOO_LOW) return first(p, v->turn);
  for (int64_t k = 0; k < e->zeros; k++) some |= v->turn[k] != 0;
  lmoc_take(e, time, p->answer);
  return found ? 2 : some;
}

void lmoc_page_turn_early(lmoc_page *p) { lmoc_turn_early(&p->events.instant, p->events.which); }

void lmoc_page_flip(lmoc_page *p) {
  lmoc_instant *e = &p->events.instant;
  for (int64_t k = 0; k < e->zeros; k++) {
    double *own = e->v + e->target[e->of_zero[k]];
    if (p->events.turn[k] != 0) *own = 1 - *own;
  }
}

void lmoc_page_leave_zero(lmoc_page *p) { lmoc_leave_zero(&p->events.instant, p->events.which); }

/* ------------------------------------------------------------------ roots */

void lmoc_page_edge_values(lmoc_page *p, double time, double *out) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  const int lost = lmoc_page_evaluate(p, (int)v->look, time) & LMOC_FAILED;
  for (int64_t k = 0; k < e->zeros; k++) v->noise[k] = lost ? NAN : p->w[v->zero[k]];
  lmoc_root_values(e, v->noise, out);
  if (!lost) lmoc_seen(e, v->noise);
}
