/* Scenes that are stepped from a loop, many in one call: what a caller does for each takes longer than a step. */

#include "abreast.h"
#include "lu.h"

void lmoc_forget(const lmoc_tape *t, int64_t blocks) {
  for (int64_t k = 0; k < blocks; k++) {
    t->blocks[k].ready = 0;
    if (t->blocks[k].lu) lmoc_lu_forget(t->blocks[k].lu);
  }
}

int64_t lmoc_dop853_abreast(lmoc_abreast *a) {
  int64_t behind = 0;
  a->evaluations = 0;
  for (int64_t k = 0; k < a->runs; k++) {
    lmoc_steps *s = a->each[k];
    const int64_t n = s->call->n;
    for (int64_t i = 0; i < a->given; i++) s->call->w[a->registers[i]] = a->values[k*a->given + i];
    lmoc_forget(s->call->tape, a->blocks);
    lmoc_dop853_restart(s);
    s->end = a->ends[k];
    s->most = a->most;
    a->found[k] = lmoc_dop853_walk(s);
    a->evaluations += s->evaluations;
    behind += a->found[k] || s->t < s->end;
    memcpy(a->x + k*n, s->x, n * sizeof(double));
  }
  return behind;
}
