/* What goes through the engine several runs at a time. */

#ifndef LMOC_MANY_H
#define LMOC_MANY_H

#include <stdint.h>

typedef struct {
  int64_t lanes, length;            /* runs at a time; coefficients that a series has room for */
  const void *run, *blocks;         /* a tape; the functions of its blocks */
  const void *order, *open, *solve; /* of a series */
  const void *walk;                 /* runs, each to where its leg ends (`lanes.c`) */
} lmoc_many;

/* Eight is there where the compiler makes code for AVX-512. */
extern const lmoc_many lmoc_four, lmoc_eight;

/* As many at a time as suit this processor. */
const lmoc_many *lmoc_at_once(void);

#endif
