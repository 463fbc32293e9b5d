/* The right-hand side as steppers and SUNDIALS call it: states into the registers, the program, derivatives out of them. */

#include "engine.h"

static int run(const lmoc_call *c, double time) {
  if (c->tables) lmoc_tables_fill(c->tables, time, c->w);
  return c->tape->run(time, c->w, c->tape);
}

static void given(lmoc_call *c, const double *x) {
  if (c->first_state >= 0) memcpy(c->w + c->first_state, x, c->given * sizeof(double));
  else for (int64_t i = 0; i < c->given; i++) c->w[c->states[i]] = x[i];
}

static void restore(lmoc_call *c, const double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) c->w[c->unknowns[k]] = solution[k];
}

static void remember(lmoc_call *c, double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) solution[k] = c->w[c->unknowns[k]];
}

void lmoc_mark(lmoc_call *c) {
  if (!c->solved) return;
  memcpy(c->solution + 2*c->remembered, c->solution, c->remembered * sizeof(double));
  memcpy(c->x + 2*c->given, c->x, c->given * sizeof(double));
  c->marked_time = c->time;
  c->marked = 1;
}

void lmoc_go_back(lmoc_call *c) {
  *c->last = 0;
  memcpy(c->solution, c->solution + 2*c->remembered, c->remembered * sizeof(double));
  memcpy(c->x, c->x + 2*c->given, c->given * sizeof(double));
  c->time = c->marked_time;
}

/* The way from the last solution in shorter steps along the straight line between the states: continuation with step
   size control (Deuflhard, section 5.1). Returns 0 where it leads all the way; the solutions stand in the registers. */
static int approach(lmoc_call *c, double time, const double *x) {
  double reached = 0, step = 0.5;
  double *near = c->solution + c->remembered, *between = c->x + c->given;
  memcpy(near, c->solution, c->remembered * sizeof(double));
  while (reached < 1 && step >= 0x1p-10) {
    const double goal = fmin(1, reached + step);
    for (int64_t i = 0; i < c->given; i++)
      between[i] = goal < 1 && x[i] != c->x[i] ? c->x[i] + goal*(x[i] - c->x[i]) : x[i];
    restore(c, near);
    given(c, between);
    if (run(c, goal < 1 ? c->time + goal*(time - c->time) : time)) step /= 2;
    else {
      remember(c, near);
      reached = goal;
      step *= 2;
    }
  }
  given(c, x);
  if (reached == 1) return 0;
  restore(c, near);
  return LMOC_FAILED;
}

/* What stands in the registers is a solution now: the last one. */
static void keep(lmoc_call *c, double time, const double *x) {
  remember(c, c->solution);
  memcpy(c->x, x, c->given * sizeof(double));
  c->time = time;
  c->solved = 1;
  *c->last = c;
}

int lmoc_evaluate(lmoc_call *c, double time, const double *x) {
  if (c->solved && *c->last == c && time == c->time && !memcmp(x, c->x, c->given * sizeof(double))) return 0;
  *c->last = 0;
  given(c, x);
  if (!c->remembered) return run(c, time);
  /* the last one may stand far ahead of a place in the step before it */
  if (c->solved && c->marked && fabs(time - c->marked_time) < fabs(time - c->time)) lmoc_go_back(c);
  if (c->solved) restore(c, c->solution);
  int status = run(c, time);
  if (status && c->solved) status = approach(c, time, x);
  if (status & LMOC_FAILED && c->solved && c->marked) {  /* the last one may stand at an attempt that led astray */
    lmoc_go_back(c);
    status = approach(c, time, x);
  }
  if (status & LMOC_FAILED && c->rescue && c->rescue(time)) status = run(c, time);
  if (status & LMOC_FAILED) return status;
  keep(c, time, x);
  return 0;
}

int lmoc_evaluate_near(lmoc_call *c, double time, const double *x) {
  *c->last = 0;
  given(c, x);
  const int status = run(c, time);
  if (!status) keep(c, time, x);
  return status;
}

/* For many times: states (count, n) and guesses of the unknowns (count, remembered) in, some registers (count, chosen)
   out, and whether each block has a solution near its guess. */
void lmoc_evaluate_many(lmoc_call *c, int64_t count, const double *times, const double *x, const double *guesses,
               int64_t chosen, const int32_t *registers, double *out, uint8_t *good) {
  *c->last = 0;
  for (int64_t k = 0; k < count; k++, x += c->given, guesses += c->remembered, out += chosen) {
    given(c, x);
    restore(c, guesses);
    good[k] = !run(c, times[k]);
    for (int64_t j = 0; j < chosen; j++) out[j] = c->w[registers[j]];
  }
}

int lmoc_rhs(double time, void *y, void *ydot, void *user) {
  lmoc_call *c = user;
  double *f = c->data(ydot);
  double check = 0;
  if (lmoc_evaluate(c, time, c->data(y))) return 1;
  for (int64_t i = 0; i < c->n; i++) { f[i] = c->w[c->derivatives[i]]; check += f[i] * 0.0; }
  return check == 0 ? 0 : 1;  /* NaN or infinity: a step that CVODE tries again, smaller */
}

/* y' - f(t, y), as IDA calls it. */
int lmoc_residual(double time, void *y, void *rate, void *residual, void *user) {
  lmoc_call *c = user;
  const double *p = c->data(rate);
  double *r = c->data(residual);
  if (lmoc_rhs(time, y, residual, user)) return 1;
  for (int64_t i = 0; i < c->n; i++) r[i] = p[i] - r[i];
  return 0;
}

void lmoc_derivatives(lmoc_call *c, double time, const double *x, double *f) {
  const int failed = lmoc_evaluate(c, time, x);
  for (int64_t i = 0; i < c->n; i++) f[i] = failed ? NAN : c->w[c->derivatives[i]];
}
