/* What is written down of events (`book.h`). */

#include "book.h"

static double stored_at(const lmoc_book *b, double time, const double *x) {
  lmoc_instant *e = b->v->e;
  return e->look(e, time, x) ? NAN : e->v[b->stored];
}

/* Book what energy a jump of states has cost as heat, what it has brought as work; the loss. */
static double energy(const lmoc_book *b, double time, double *x) {
  if (!b->v->jumped || b->stored < 0 || b->work < 0) return 0;
  const double before = stored_at(b, time, b->v->begun), lost = before - stored_at(b, time, x);
  if (!(lost * 0 == 0)) return lost;
  x[lost > 0 ? b->heat : b->work] += fabs(lost);
  return fmax(lost, 0);
}

/* Whether an event has changed what the equations of the motion read. */
static int turns(const lmoc_book *b) {
  const lmoc_instant *e = b->v->e;
  for (int64_t i = 0; i < b->deciding; i++)
    if (b->v->held[b->decides[i]] != e->v[e->own[b->decides[i]]]) return 1;
  return 0;
}

/* Returns whether a condition has been met after which the run does not go on. */
static int write(lmoc_book *b, double time, double lost) {
  const lmoc_instant *e = b->v->e;
  double *to = b->page + b->filled, *at = to + LMOC_ENTRY;
  int stops = 0;
  to[1] = time;
  to[2] = (double)b->v->kind;
  to[3] = lost;
  to[4] = -1;
  for (int64_t i = e->discrete; i-- > 0;)
    if (!(e->v[e->own[i]] * 0 == 0)) to[4] = (double)i, to[5] = e->v[e->own[i]];
  to[6] = (double)e->found_count;
  for (int64_t i = 0; i < e->found_count; i++) {
    *at++ = (double)e->found[i];
    stops |= b->stops[e->found[i]];
  }
  for (int64_t i = 0; i < b->told; i++) {
    const double before = b->v->held[b->tell[i]], now = e->v[e->own[b->tell[i]]];
    if (before != now) at[0] = (double)i, at[1] = before, at[2] = now, at += 3;
  }
  to[0] = (double)(at - to);
  b->filled += at - to;
  return stops;
}

int lmoc_book_event(lmoc_events *v, double time, double *x) {
  lmoc_book *b = v->owner;
  double lost = 0;
  int found;
  if (b->filled + lmoc_entry_size(b) > b->size) return LMOC_HALTED;
  if (v->kind != LMOC_START) lost = energy(b, time, x);
  if (b->step && (found = b->step(v, time, x))) return found;
  if (v->jumped || turns(b)) b->turned = time;
  return write(b, time, lost) ? LMOC_HALTED : LMOC_SETTLED;
}
