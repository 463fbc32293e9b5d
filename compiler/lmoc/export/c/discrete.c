/* What `engine/c/instant.c` asks an FMU: values at a place, on the tapes of `export/instants.py`. */

#include "discrete.h"
#include "fmu_loops.h"

int fmu_unsettled(fmu *f) {
  return fmu_refused(f, "no values of the discrete variables satisfy all equations at an event");
}

/* ------------------------------------------------------------------ looking */

double fmu_value(const fmu *f, int64_t zero) { return f->w[LOOK][f->model->events.zero[zero]]; }

static int look(lmoc_instant *e, double t, const double *x) {
  fmu *f = e->owner;
  const fmu_events *m = &f->model->events;
  if (fmu_look(f, t, x)) return LMOC_NO_VALUE;
  for (int64_t k = 0; k < e->zeros; k++) e->zero[k] = fmu_value(f, k);
  for (int64_t i = 0; i < m->seen; i++) e->v[m->seen_registers[i]] = f->w[LOOK][m->seen_registers[i]];
  return LMOC_SETTLED;
}

static int widen(lmoc_instant *e, double t, const double *x) {
  return lmoc_widen_beside(e, t, x, ((fmu *)e->owner)->noise);
}

void fmu_ask(fmu *f) {
  f->e.owner = f;
  f->e.look = look;
  f->e.widen = widen;
  f->e.others = lmoc_try_relations;
  f->e.move = fmu_move;
  f->e.follow = f->model->loops.stages ? fmu_loops_follow : 0;
  fmu_ask_events(f);
}
