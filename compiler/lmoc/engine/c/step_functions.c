/* Functions along a step (`step_functions.h`). */

#include "step_functions.h"

#include "roots.h"
#include "taylor.h"

#include <string.h>

void lmoc_step_states(lmoc_step_functions *s, double time, double *x) {
  const size_t size = (size_t)s->n * sizeof(double);
  const double h = time - s->before;
  if (time == s->begin) memcpy(x, s->first, size); /* a method may not come back to it exactly */
  else if (time == s->end) memcpy(x, s->last, size);
  else lmoc_taylor_values(s->n, s->order, 1, &h, s->series, x);
}

static void functions(const lmoc_watched *part, double time, const double *x, double *out) {
  const double none = 0;
  uint8_t good;
  lmoc_evaluate_many(part->call, 1, &time, x, &none, part->chosen, part->registers, part->read, &good);
  if (part->laws) {
    lmoc_law_values(part->laws, 1, part->read, out);
  } else {
    lmoc_root_values(part->events, part->read, out);
    lmoc_seen(part->events, part->read);
  }
}

int lmoc_step_values(void *owner, int64_t count, const double *times, double *values) {
  lmoc_step_functions *s = owner;
  for (int64_t i = 0; i < count; i++) {
    lmoc_step_states(s, times[i], s->x);
    for (int64_t j = 0; j < s->n; j++) s->largest[j] = fmax(s->largest[j], fabs(s->x[j]));
    for (int64_t k = 0; k < s->parts; values += s->part[k++].count) functions(s->part + k, times[i], s->x, values);
  }
  for (int64_t k = 0; k < s->parts; k++) if (s->part[k].events) lmoc_followed(s->part[k].events);
  return 0;
}

int lmoc_step_quiet(void *owner, double time, const double *heights, uint8_t *out) {
  lmoc_step_functions *s = owner;
  memset(out, 0, (size_t)s->count);
  for (int64_t k = 0; k < s->parts; heights += s->part[k].count, out += s->part[k++].count) {
    lmoc_instant *e = s->part[k].events;
    if (!e) continue;
    for (int64_t i = 0; i < e->zeros; i++) s->part[k].read[i] = heights[i] - e->margin[i];
    if (lmoc_quiet(e, time, s->x, s->part[k].read, out)) return LMOC_ROOTS_HALTED;
  }
  return 0;
}
