/* The values of an instance of an FMU: set, computed where they are asked for, and derived. */

#include "fmu_laws.h"
#include "fmu_loops.h"

void fmu_changed(fmu *f) {
  f->now.evaluated = f->now.observed = 0;
  f->last = 0;
}

/* Parameters and inputs into the registers. */
void fmu_settle(fmu *f) {
  const fmu_model *m = f->model;
  const fmu_events *e = &m->events;
  const int renewed = f->now.stale, runs = !(f->now.phase & (FMU_FRESH | FMU_INITIALIZING | FMU_CONFIGURING));
  for (int64_t i = 0; i < m->inputs; i++) f->w[RIGHT][m->input[i]] = f->u[i];
  if (renewed) {
    if (runs && m->laws.laws.count) fmu_law_look(f);
    double *w = f->w[PARAMETRIC];
    for (int64_t i = 0; i < m->parameters; i++) w[m->parameter[i]] = f->p[i];
    fmu_forget(f);
    lmoc_tape_run(NAN, w, f->tape + PARAMETRIC);
    fmu_law_parameters(f);
    fmu_loops_parameters(f);
    for (int64_t i = 0; i < m->given; i++) f->w[RIGHT][m->given_registers[i]] = w[m->given_registers[i]];
    for (int k = LOOK; k <= BEGIN; k++)
      for (int64_t i = 0; i < e->parameters; i++) f->w[k][e->parameter_registers[i]] = w[e->parameter_registers[i]];
    if (!runs) { /* later the last solution is the nearest */
      fmu_guess(f);
      f->call.solved = f->call.marked = f->now.closed = f->now.compared = 0;
    }
    f->now.stale = f->now.fits = 0;
    fmu_changed(f);
  }
  for (int64_t i = 0; i < f->e.discrete; i++)
    if (f->w[RIGHT][e->registers[i]] != f->e.v[f->e.own[i]]) {
      f->w[RIGHT][e->registers[i]] = f->e.v[f->e.own[i]];
      f->call.solved = f->call.marked = 0; /* the equations are others: their solution may be elsewhere */
      fmu_changed(f);
    }
  if (!m->laws.laws.count) return;
  fmu_law_mode(f);
  if (!renewed) return;
  fmu_law_given(f);
  lmoc_law_renew(&f->laws);
  if (runs) fmu_law_compare(f);
}

int fmu_fits(fmu *f) {
  const fmu_model *m = f->model;
  fmu_settle(f);
  for (int64_t i = 0; i < m->assumed && !f->now.fits; i++) {
    if (f->w[PARAMETRIC][m->assumption[i]] != 0) continue;
    if (m->assumption_error[i]) return fmu_refused(f, m->assumption_texts[i]);
    f->warn(f->owner, m->assumption_texts[i]);
  }
  f->now.fits = 1;
  return FMU_GOOD;
}

int fmu_lost(fmu *f) {
  f->tell(f->owner, "the equations of a nonlinear block have no solution near the last one");
  return FMU_NO_VALUE;
}

/* Fill what is observed, from what has been solved. */
static int fill_observed(fmu *f, double time) {
  const fmu_model *m = f->model;
  for (int64_t i = 0; i < m->kept; i++) f->w[OBSERVE][m->kept_registers[i]] = f->w[RIGHT][m->kept_registers[i]];
  return lmoc_tape_run(time, f->w[OBSERVE], f->tape + OBSERVE) & LMOC_FAILED ? FMU_NO_VALUE : FMU_GOOD;
}

/* `simulate` looks for the way to close loops that is nearest to the guesses of the model, an instance for the one that
   is nearest to the scene's own. */
static void compare_loops(fmu *f, double time) {
  const fmu_model *m = f->model;
  f->now.compared = 1;
  if (!m->tied || fill_observed(f, time)) return;
  for (int64_t i = 0; i < m->tied; i++)
    if (fabs(f->w[OBSERVE][m->tied_registers[i]] - m->tied_values[i]) > m->reach[i]) {
      f->warn(f->owner, "with these values closed loops begin far from where they do in the scene: lmoc may close them in "
                        "another way, or whole turns away; an FMU that is exported with these values begins as lmoc does");
      return;
    }
}

/* The equations at a place; loops are closed first as the scene is at its start, from where the way leads there. */
int fmu_solve(fmu *f, double time, const double *x) {
  if (f->call.remembered && !f->now.closed) lmoc_evaluate(&f->call, f->model->start_time, f->model->start);
  if (lmoc_evaluate(&f->call, time, x)) return fmu_lost(f);
  f->now.closed = 1;
  if (!f->now.compared) compare_loops(f, time);
  return FMU_GOOD;
}

int fmu_look(fmu *f, double time, const double *x) {
  const fmu_events *e = &f->model->events;
  fmu_settle(f);
  f->now.evaluated = f->now.observed = 0;
  if (fmu_solve(f, time, x)) return FMU_NO_VALUE;
  for (int64_t i = 0; i < e->kept; i++) f->w[LOOK][e->kept_registers[i]] = f->w[RIGHT][e->kept_registers[i]];
  return lmoc_tape_run(time, f->w[LOOK], f->tape + LOOK) & LMOC_FAILED ? FMU_NO_VALUE : FMU_GOOD;
}

int fmu_evaluate(fmu *f) {
  if (fmu_fits(f)) return FMU_WRONG;
  if (!f->now.begun && !f->now.settled && (f->e.discrete || f->model->laws.laws.count || f->model->loops.stages)) {
    const int found = fmu_begin(f, 0);
    f->now.settled = !found;
    if (found) return found;
  }
  if (f->now.evaluated) return FMU_GOOD;
  if (fmu_solve(f, f->now.time, f->x)) return FMU_NO_VALUE;
  f->now.evaluated = 1;
  return FMU_GOOD;
}

static int observe(fmu *f) {
  const int found = fmu_evaluate(f);
  if (found || f->now.observed) return found;
  if (fill_observed(f, f->now.time)) return FMU_NO_VALUE;
  f->now.observed = 1;
  return FMU_GOOD;
}

int fmu_get(fmu *f, uint32_t reference, double *value) {
  const fmu_model *m = f->model;
  if (!reference) {
    *value = f->now.time;
    return FMU_GOOD;
  }
  const int64_t row = (int64_t)reference - 1;
  if (row >= m->variables) {
    f->tell(f->owner, "there is no variable with this value reference");
    return FMU_WRONG;
  }
  const int32_t place = m->place[row];
  int found = FMU_GOOD;
  switch (m->kind[row]) {
    case FMU_PARAMETER: *value = f->p[place]; break;
    case FMU_DISCRETE:
      found = fmu_evaluate(f);
      *value = f->e.v[f->e.own[place]];
      break;
    case FMU_INDICATOR:
      found = fmu_evaluate(f);
      if (!found) found = fmu_indicators(f, f->now.time, f->x, f->root);
      *value = found ? NAN : f->root[place];
      break;
    case FMU_DERIVED: fmu_settle(f); *value = f->w[PARAMETRIC][place]; break;
    case FMU_STATE:
      if (m->loops.stages && !f->now.begun) found = fmu_evaluate(f); /* they follow from others */
      *value = f->x[place];
      break;
    case FMU_INPUT: *value = f->u[place]; break;
    case FMU_DERIVATIVE:
      found = fmu_evaluate(f);
      *value = found ? NAN : f->w[RIGHT][m->derivative[place]];
      break;
    default:
      found = observe(f);
      *value = found ? NAN : f->w[OBSERVE][place];
  }
  return found;
}

int fmu_refused(fmu *f, const char *text) {
  f->tell(f->owner, text);
  return FMU_WRONG;
}

int fmu_set(fmu *f, uint32_t reference, double value) {
  const fmu_model *m = f->model;
  const int64_t row = (int64_t)reference - 1;
  const int phase = f->now.phase, before = phase & (FMU_FRESH | FMU_INITIALIZING | FMU_CONFIGURING);
  if (!reference || row >= m->variables) return fmu_refused(f, "there is no variable with this value reference to be set");
  if (!(value * 0 == 0)) return fmu_refused(f, "a variable was set to what is no finite number");
  const int32_t place = m->place[row];
  switch (m->kind[row]) {
    case FMU_PARAMETER:
      if (!before && !(phase & FMU_EVENT) && !(f->now.co_simulation && phase & FMU_STEPPING))
        return fmu_refused(f, "parameters can be set before initialization and at events");
      if (!before && m->loops.stages && m->loops.closing[place])
        return fmu_refused(f, "a parameter that closed loops depend on can be set before and in initialization");
      f->now.stale |= f->p[place] != value;
      if (f->p[place] != value) fmu_surprise(f);
      f->p[place] = value;
      break;
    case FMU_STATE:
      if (!before) return fmu_refused(f, "the start value of a state can be set before and in initialization");
      if (m->loops.stages && m->loops.held[place] != 0)
        return fmu_refused(f, "this state follows from others where its loops are closed, and cannot be set");
      f->x[place] = value;
      break;
    case FMU_INPUT:
      if (f->u[place] != value) fmu_surprise(f);
      f->u[place] = value;
      break;
    default:
      return fmu_refused(f, "this variable is calculated, and cannot be set");
  }
  if (before) f->now.settled = f->now.compared = 0;
  fmu_changed(f);
  return FMU_GOOD;
}

int fmu_derivatives(fmu *f, double *out) {
  const int found = fmu_evaluate(f);
  double check = 0;
  for (int64_t i = 0; i < f->model->states; i++) {
    out[i] = found ? NAN : f->w[RIGHT][f->model->derivative[i]];
    check += out[i] * 0;
  }
  return found ? found : check == 0 ? FMU_GOOD : FMU_NO_VALUE;
}

int fmu_states(fmu *f, double *out) {
  const int found = f->model->loops.stages && !f->now.begun ? fmu_evaluate(f) : FMU_GOOD; /* they follow from others */
  memcpy(out, f->x, (size_t)f->model->states * sizeof(double));
  return found;
}

void fmu_set_time(fmu *f, double time) {
  if (time != f->now.time) fmu_changed(f);
  f->now.time = time;
}

void fmu_set_states(fmu *f, const double *x) {
  memcpy(f->x, x, f->model->states * sizeof(double));
  fmu_changed(f);
}

/* ------------------------------------------------------------------ derivatives in a direction */

static int64_t row_of(const fmu_model *m, uint32_t reference) {
  const int64_t row = (int64_t)reference - 1;
  if (!reference || row >= m->variables) return -1;
  if (m->kind[row] == FMU_DERIVATIVE) return m->place[row];
  if (m->kind[row] != FMU_OBSERVED && m->kind[row] != FMU_STATE) return -1;
  const int32_t wanted = m->kind[row] == FMU_STATE ? m->state[m->place[row]] : m->place[row];
  for (int64_t k = 0; k < m->states; k++)
    if (m->derivative[k] == wanted) return k;
  for (int64_t k = 0; k < m->outputs; k++)
    if (m->output[k] == wanted) return m->states + k;
  return -1;
}

static int64_t column_of(const fmu_model *m, uint32_t reference) {
  const int64_t row = (int64_t)reference - 1;
  if (!reference || row >= m->variables) return -1;
  if (m->kind[row] == FMU_STATE) return m->place[row];
  return m->kind[row] == FMU_INPUT ? m->states + m->place[row] : -1;
}

int fmu_directional(fmu *f, const uint32_t *unknowns, size_t rows, const uint32_t *knowns, size_t columns,
                    const double *seed, double *out, int adjoint) {
  const fmu_model *m = f->model;
  int found = observe(f);
  if (found) return found;
  double *w = f->w[SLOPES];
  memcpy(w, f->w[OBSERVE], m->registers * sizeof(double));
  lmoc_tape_run(f->now.time, w, f->tape + SLOPES);
  for (size_t i = 0; i < (adjoint ? columns : rows); i++) out[i] = 0;
  for (size_t j = 0; j < columns; j++) {
    const int64_t column = column_of(m, knowns[j]);
    if (column < 0) return fmu_refused(f, "derivatives are by states and inputs");
    for (size_t i = 0; i < rows; i++) {
      const int64_t row = row_of(m, unknowns[i]);
      if (row < 0) return fmu_refused(f, "only derivatives and outputs have directional derivatives");
      for (int64_t e = 0; e < m->slopes.result_count; e++)
        if (m->rows[e] == row && m->columns[e] == column) {
          const double value = w[m->slopes.results[e]];
          if (!(value * 0 == 0)) found = FMU_NO_VALUE;
          out[adjoint ? j : i] += value * seed[adjoint ? i : j];
        }
    }
  }
  return found;
}
