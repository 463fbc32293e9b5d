/* What is written down of the events of a run, for who tells of them later: their energy, and what has changed. */

#ifndef LMOC_BOOK_H
#define LMOC_BOOK_H

#include "happen.h"

typedef struct {
  lmoc_events *v;
  int64_t stored;             /* the place of the stored energy among the values; -1: none is known */
  int64_t work, heat;         /* which states keep accounts; -1: none */
  int64_t told, deciding;
  const int64_t *tell;        /* (told,) which discrete values are told of where they have changed … */
  const int64_t *decides;     /* (deciding,) … and which ones decide about the motion */
  const uint8_t *stops;       /* conditions of which something is told, after which a run does not go on */
  int (*step)(lmoc_events *v, double time, double *x); /* what a step of discrete values does to states, but at the start; or 0 */
  double turned;              /* s, of the latest event that has changed the motion */
  double *page;               /* (size,) one entry behind the other */
  int64_t size, filled;
} lmoc_book;

/* Numbers of the longest entry: its length, when, what it is called, the energy that is lost, which discrete value is not
   finite and how large it is, or -1; how many conditions, and which; and of each change which, before and after. */
enum { LMOC_ENTRY = 7 };
static inline int64_t lmoc_entry_size(const lmoc_book *b) { return LMOC_ENTRY + b->v->e->told + 3*b->told; }

/* As `happened` of the events, whose owner it is. Halts where the run ends, or where the page is full. */
int lmoc_book_event(lmoc_events *v, double time, double *x);

#endif
