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
  p->switched = 1; /* other discrete values may hold than at the last solution */
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

static void defects(lmoc_events *way) { lmoc_page_defects(way->owner, way->defect); }

/* ------------------------------------------------------------------ what happens */

static double stored_at(lmoc_page *p, double time, const double *x) {
  return lmoc_take(&p->events.instant, time, x) ? NAN : p->w[p->events.stored];
}

/* Book what energy a jump of states has cost as heat, what it has brought as work. */
static void book_jump(lmoc_page *p, double time) {
  page_events *v = &p->events;
  v->lost = 0;
  if (!v->way.jumped || v->stored < 0 || v->work_state < 0 || v->heat_state < 0) return;
  const double before = stored_at(p, time, v->way.begun);
  v->lost = before - stored_at(p, time, p->answer);
  if (v->lost * 0 == 0) p->answer[v->lost > 0 ? v->heat_state : v->work_state] += fabs(v->lost);
  if (v->lost < 0) v->lost = 0;
}

/* Book what an event has done; the host is told. */
static int booked(lmoc_events *way, double time, double *x) {
  lmoc_page *p = way->owner;
  int wrong = 0;
  if (way->kind != LMOC_START) {
    book_jump(p, time);
    wrong = lmoc_page_discrete_steps(p, time);
  }
  p->instant = time;
  memcpy(p->x, x, p->n * sizeof(double));
  lmoc_host_event(wrong);
  return LMOC_SETTLED;
}

double lmoc_page_happened(const lmoc_page *p, int which) {
  const page_events *v = &p->events;
  const double all[] = {v->next, (double)v->way.kind, v->lost};
  return all[which];
}

double *lmoc_page_before(lmoc_page *p) { return p->events.way.held; }

int lmoc_page_told_count(const lmoc_page *p) { return (int)p->events.instant.found_count; }

int lmoc_page_told_of(const lmoc_page *p, int k) { return (int)p->events.instant.found[k]; }

/* Tell the host where nothing is known behind an instant. */
static int reported(lmoc_page *p, int found) {
  const int switches = found == LMOC_TOO_LOW || found == LMOC_TOO_OFTEN;
  memcpy(p->x, p->answer, p->n * sizeof(double));
  if (found && found != LMOC_OVER) lmoc_host_event(switches ? 100 + (int)p->events.way.culprit : found);
  return found;
}

int lmoc_page_events_after(lmoc_page *p, double time, int crossed) {
  return reported(p, lmoc_events_after(&p->events.way, time, p->answer, crossed));
}

int lmoc_page_events_settle(lmoc_page *p, double time) {
  return reported(p, lmoc_events_settle(&p->events.way, time, p->answer));
}

/* ------------------------------------------------------------------ the start */

static int states(lmoc_events *way, double *x) {
  lmoc_page *p = way->owner;
  lmoc_host_states();
  memmove(x, p->answer, p->n * sizeof(double));
  return LMOC_SETTLED;
}

static int equations(lmoc_events *way, int first) {
  (void)way;
  lmoc_host_equations(first);
  return LMOC_SETTLED;
}

void lmoc_page_start_events(lmoc_page *p, double time) {
  p->instant = time;
  reported(p, lmoc_events_start(&p->events.way, time, p->answer, 0));
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
  const int64_t sum = 5*n + 3*d + 8*zeros + 2*e->relations + 2*d + LMOC_HISTORY*d + zeros*(LMOC_CHATTER + 10) + 8*n + 8;
  double *at = calloc((size_t)(sum + 3*zeros), sizeof(double));
  e->found = calloc((size_t)e->told + 1, sizeof(int64_t));
  e->near = calloc((size_t)zeros + 1, 1);
  if (!at || !e->found || !e->near) return 0;
#define TAKE(name, count) (v->name = at, at += (count))
  TAKE(instant.zero, zeros), TAKE(instant.margin, zeros), TAKE(instant.largest, zeros), TAKE(instant.high, zeros);
  TAKE(instant.supposed, e->relations), TAKE(instant.early, e->relations), TAKE(instant.changed, d);
  TAKE(instant.flipped, d), TAKE(instant.moved, n), TAKE(instant.history, LMOC_HISTORY*d);
  TAKE(hops.times, zeros*LMOC_CHATTER), TAKE(hops.home, zeros), TAKE(hops.work, 4*n + 9*zeros);
  TAKE(work, 2*n + 3*zeros), TAKE(noise, zeros), TAKE(way.which, zeros), TAKE(way.turn, zeros), TAKE(way.at, zeros);
  TAKE(way.begun, n), TAKE(way.held, d), TAKE(left, n), TAKE(errors, n), TAKE(way.defect, n), TAKE(state, n), TAKE(past, d), TAKE(now, d);
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
  v->way.initial = lmoc_read_integer(b);
  v->way.terminal = lmoc_read_integer(b);
  v->stored = lmoc_read_integer(b);
  v->work_state = lmoc_read_integer(b);
  v->heat_state = lmoc_read_integer(b);
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
  v->way.e = e;
  v->way.h = &v->hops;
  v->way.next = &v->next;
  v->way.turned = &v->turned;
  v->way.owner = p;
  v->way.happened = booked;
  v->way.defects = defects;
  v->way.states = states;
  v->way.equations = equations;
  if (!make_room(v, p->n)) b->failed = 1;
}

void lmoc_page_begin_events(lmoc_page *p, double time, double span) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  for (int64_t k = 0; k < e->zeros; k++) e->margin[k] = e->largest[k] = e->high[k] = v->hops.home[k] = 0;
  for (int64_t k = 0; k < e->zeros; k++) v->hops.home[k] = -INFINITY;
  for (int64_t k = 0; k < e->zeros * LMOC_CHATTER; k++) v->hops.times[k] = -INFINITY;
  for (int64_t k = 0; k < e->relations; k++) e->early[k] = 0;
  for (int64_t k = 0; k < p->jumps.early_count; k++) e->early[p->jumps.early[k]] = 1;
  v->next = INFINITY;
  v->turned = -INFINITY;
  p->reached = -INFINITY;
  v->hops.begin = time;
  v->hops.span = span;
  e->time = time;
  e->literal = 1;
  lmoc_remember(e);
}

/* ------------------------------------------------------------------ roots */

void lmoc_page_edge_values(lmoc_page *p, double time, double *out) {
  page_events *v = &p->events;
  lmoc_instant *e = &v->instant;
  const int lost = lmoc_page_evaluate(p, (int)v->look, time) & LMOC_FAILED;
  for (int64_t k = 0; k < e->zeros; k++) v->noise[k] = lost ? NAN : p->w[v->zero[k]];
  lmoc_root_values(e, v->noise, out);
  if (!lost) lmoc_seen(e, v->noise);
}
