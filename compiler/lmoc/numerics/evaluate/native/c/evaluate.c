/* The right-hand side as SUNDIALS calls it: states into the registers, the program, derivatives out of them. */

typedef struct lmoc_call {
  double *w;
  const int64_t *m;
  const void *const *tab;
  int64_t n, first_state;
  const int32_t *states, *derivatives;
  double *(*data)(void *);
  int64_t remembered, solved;   /* unknowns of nonlinear blocks; whether they have been solved before … */
  const int32_t *unknowns;
  double *solution, *x, time;   /* … and how, with which states, and when */
  int (*rescue)(double time);
  double marked_time;
  int64_t marked;               /* whether a solution has been marked; it stands behind the others */
  const struct lmoc_call **last;  /* whose last solution stands in the registers, which several may share; or 0 */
} lmoc_call;

static void lmoc_given(lmoc_call *c, const double *x) {
  if (c->first_state >= 0) memcpy(c->w + c->first_state, x, c->n * sizeof(double));
  else for (int64_t i = 0; i < c->n; i++) c->w[c->states[i]] = x[i];
}

static void lmoc_restore(lmoc_call *c, const double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) c->w[c->unknowns[k]] = solution[k];
}

static void lmoc_remember(lmoc_call *c, double *solution) {
  for (int64_t k = 0; k < c->remembered; k++) solution[k] = c->w[c->unknowns[k]];
}

/* Mark the last solution as one to go back to: that of an accepted step. */
void lmoc_mark(lmoc_call *c) {
  if (!c->solved) return;
  memcpy(c->solution + 2*c->remembered, c->solution, c->remembered * sizeof(double));
  memcpy(c->x + 2*c->n, c->x, c->n * sizeof(double));
  c->marked_time = c->time;
  c->marked = 1;
}

static void lmoc_go_back(lmoc_call *c) {
  *c->last = 0;
  memcpy(c->solution, c->solution + 2*c->remembered, c->remembered * sizeof(double));
  memcpy(c->x, c->x + 2*c->n, c->n * sizeof(double));
  c->time = c->marked_time;
}

/* The way from the last solution in shorter steps along the straight line between the states: continuation with step
   size control (Deuflhard, section 5.1). Returns 0 where it leads all the way; the solutions stand in the registers. */
static int lmoc_approach(lmoc_call *c, double time, const double *x) {
  double reached = 0, step = 0.5;
  double *near = c->solution + c->remembered, *between = c->x + c->n;
  memcpy(near, c->solution, c->remembered * sizeof(double));
  while (reached < 1 && step >= 0x1p-10) {
    const double goal = fmin(1, reached + step);
    for (int64_t i = 0; i < c->n; i++)
      between[i] = goal < 1 && x[i] != c->x[i] ? c->x[i] + goal*(x[i] - c->x[i]) : x[i];
    lmoc_restore(c, near);
    lmoc_given(c, between);
    if (lmoc_program(goal < 1 ? c->time + goal*(time - c->time) : time, c->w, c->m, c->tab)) step /= 2;
    else {
      lmoc_remember(c, near);
      reached = goal;
      step *= 2;
    }
  }
  lmoc_given(c, x);
  if (reached == 1) return 0;
  lmoc_restore(c, near);
  return LMOC_FAILED;
}

/* Run the program for some states. Nonlinear blocks start from their last solution and stay near it; where that is
   impossible, they have none, and keep the last one for the next time. */
int lmoc_evaluate(lmoc_call *c, double time, const double *x) {
  if (c->solved && *c->last == c && time == c->time && !memcmp(x, c->x, c->n * sizeof(double))) return 0;
  *c->last = 0;
  lmoc_given(c, x);
  if (!c->remembered) return lmoc_program(time, c->w, c->m, c->tab);
  if (c->solved) lmoc_restore(c, c->solution);
  int status = lmoc_program(time, c->w, c->m, c->tab);
  if (status && c->solved) status = lmoc_approach(c, time, x);
  if (status & LMOC_FAILED && c->solved && c->marked) {  /* the last one may stand at an attempt that led astray */
    lmoc_go_back(c);
    status = lmoc_approach(c, time, x);
  }
  if (status & LMOC_FAILED && c->rescue && c->rescue(time)) status = lmoc_program(time, c->w, c->m, c->tab);
  if (status & LMOC_FAILED) return status;
  lmoc_remember(c, c->solution);
  memcpy(c->x, x, c->n * sizeof(double));
  c->time = time;
  c->solved = 1;
  *c->last = c;
  return 0;
}

/* For many times: states (count, n) and guesses of the unknowns (count, remembered) in, some registers (count, chosen)
   out, and whether each block has a solution near its guess. */
void lmoc_many(lmoc_call *c, int64_t count, const double *times, const double *x, const double *guesses,
               int64_t chosen, const int32_t *registers, double *out, uint8_t *good) {
  *c->last = 0;
  for (int64_t k = 0; k < count; k++, x += c->n, guesses += c->remembered, out += chosen) {
    lmoc_given(c, x);
    lmoc_restore(c, guesses);
    good[k] = !lmoc_program(times[k], c->w, c->m, c->tab);
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

static void lmoc_derivatives(lmoc_call *c, double time, const double *x, double *f) {
  const int failed = lmoc_evaluate(c, time, x);
  for (int64_t i = 0; i < c->n; i++) f[i] = failed ? NAN : c->w[c->derivatives[i]];
}
