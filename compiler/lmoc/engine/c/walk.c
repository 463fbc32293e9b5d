/* Steps of DOP853 with the control of their length, many at a time. The rules are those of `steps/dop853.py`, which
   makes the steps where Python looks at each of them: both come to the same steps. */

#include "walk.h"

static void all_stages(lmoc_steps *s, double time, double h) {
  if (s->staged) return;
  lmoc_dop853_more(s->call, time, h, s->weights, s->nodes, s->x, s->k, s->last);
  s->evaluations += 3;
  s->staged = 1;
}

/* Size of the last term of the dense output in tolerances. */
static double roughness(const lmoc_steps *s, double h) {
  const int64_t n = s->call->n;
  double sum = 0;
  for (int64_t i = 0; i < n; i++) {
    double e = 0;
    for (int j = 0; j < 16; j++) e += s->omitted[j] * s->k[j*n + i];
    e /= s->atol[i] + s->rtol*fabs(s->x[i]);
    sum += e*e;
  }
  return h * sqrt(sum / (double)n);
}

/* Whether the latest steps get on though the values around are not finite. */
static int gets_on(lmoc_steps *s) {
  if (s->cuts < s->rules->cuts) return 1;
  const double advance = s->t - s->cuts_since, needed = s->cuts * s->rules->pace * (s->end - s->t);
  s->cuts = 0;
  s->cuts_since = s->t;
  return advance >= needed;
}

int lmoc_dop853_choose(lmoc_steps *s) {
  s->trial = fmin(s->step_size, s->max_step);
  return gets_on(s) ? 0 : LMOC_LOST;
}

int lmoc_dop853_propose(lmoc_steps *s) {
  s->goal = s->t + s->trial;
  if (s->t + 1.001*s->trial >= s->end) { s->goal = s->end; s->trial = s->end - s->t; }
  if (!(s->trial > 8e-16 * fabs(s->goal)) || s->trial < s->rules->least) {
    s->step_size = s->trial;
    return s->lost ? LMOC_LOST : LMOC_SHORT;
  }
  memcpy(s->k, s->f, s->call->n * sizeof(double));
  return 0;
}

int lmoc_dop853_judge(lmoc_steps *s, const double *result) {
  const lmoc_rules *r = s->rules;
  const double wanted = s->hook ? -INFINITY : s->reached < s->outputs ? s->times[s->reached] : INFINITY;
  s->evaluations += 12;
  s->staged = 0;
  s->length = s->trial;
  s->error = result[0];
  s->stiffness = result[1];
  if (s->error < 1) {
    s->lost = 0;
    return s->stiffness >= r->rough_from && wanted < s->goal ? LMOC_ROUGH : LMOC_GOOD;
  }
  if (s->call->marked) lmoc_go_back(s->call);
  s->lost = !(s->error * 0 == 0);
  s->cuts += (double)s->lost;
  s->trial *= s->lost ? r->retry : fmax(r->shrink, r->safety * pow(s->error, -0.125));
  s->grow = 1;
  s->rejected++;
  return LMOC_AGAIN;
}

int lmoc_dop853_judge_within(lmoc_steps *s) {
  const lmoc_rules *r = s->rules;
  if (!(roughness(s, s->trial) > r->rough)) return LMOC_GOOD;
  s->careful = r->careful_steps;
  s->trial *= r->careful / s->stiffness;
  s->rejected++;
  return LMOC_AGAIN;
}

/* Try steps until one is accurate enough; the reason where there is none. */
static int attempt(lmoc_steps *s) {
  double result[2];
  int found = lmoc_dop853_choose(s), judged = LMOC_AGAIN;
  while (!found && judged == LMOC_AGAIN) {
    if ((found = lmoc_dop853_propose(s))) break;
    lmoc_dop853_attempt(s->call, s->t, s->trial, s->rtol, s->weights, s->nodes, s->x, s->atol, s->k, s->x_new, s->last,
                        result);
    judged = lmoc_dop853_judge(s, result);
    if (judged != LMOC_ROUGH) continue;
    all_stages(s, s->t, s->trial);
    judged = lmoc_dop853_judge_within(s);
  }
  return found;
}

/* Whether the step just tried is certainly good. */
static int is_certain(lmoc_steps *s) {
  const lmoc_step_hook *hook = s->hook;
  if (!hook) return 1;
  if (hook->look(hook->own, s->goal, s->x_new, 1)) return 0;
  if (hook->land) {
    memcpy(s->landed, s->x_new, s->call->n * sizeof(double));
    if (hook->land(hook->own, s->goal, s->landed)) return 0;
  }
  hook->keep(hook->own);
  return 1;
}

int lmoc_dop853_accept(lmoc_steps *s) {
  const lmoc_rules *r = s->rules;
  s->steps++;
  s->careful -= s->careful > 0;
  s->before = s->t;
  s->t = s->goal;
  s->pending = 1;
  const double factor = s->error > 0 ? fmin(s->grow, fmax(r->shrink, r->safety * pow(s->error, -0.125))) : s->grow;
  const int held = s->careful > 0 && factor * s->stiffness > r->careful;
  s->grow = r->grow;
  const int limited = held || s->stiffness > r->stiff_limit;
  if (limited) {
    s->stiff_count++;
    s->calm_count = 0;
    if (s->stiff_count >= r->stiff_steps && (s->end - s->t) / s->length > s->patience) {
      s->step_size = s->length;
      return LMOC_STIFF;
    }
  } else if (s->stiff_count > 0 && ++s->calm_count >= r->calm_steps) s->stiff_count = 0;
  s->step_size = s->length * (held ? r->careful / s->stiffness : factor);
  return 0;
}

/* Coefficients of the polynomial within the last step (Hairer, Nørsett, Wanner I, II.6), as in
   `dop853/dense_output.py`. */
static void polynomial(const lmoc_steps *s) {
  const int64_t n = s->call->n;
  const double h = s->length, *k = s->k;
  double *t = s->terms;
  for (int64_t i = 0; i < n; i++) {
    const double rise = s->x_new[i] - s->x[i];
    t[i] = rise;
    t[n + i] = h*k[i] - rise;
    t[2*n + i] = 2*rise - h*(k[12*n + i] + k[i]);
  }
  for (int d = 0; d < 4; d++) {
    double *own = t + (3 + d)*n;
    for (int64_t i = 0; i < n; i++) own[i] = 0;
    for (int j = 0; j < 16; j++) {
      const double b = s->dense[16*d + j];
      if (b != 0) for (int64_t i = 0; i < n; i++) own[i] += b * k[j*n + i];
    }
    for (int64_t i = 0; i < n; i++) own[i] *= h;
  }
}

void lmoc_dop853_dense(lmoc_steps *s) {
  all_stages(s, s->before, s->length);
  polynomial(s);
}

void lmoc_dop853_within(const lmoc_steps *s, double theta, double *y) {
  const int64_t n = s->call->n;
  const double rest = 1 - theta, *t = s->terms;
  for (int64_t i = 0; i < n; i++) {
    double v = t[6*n + i] * theta;
    v = (v + t[5*n + i]) * rest;
    v = (v + t[4*n + i]) * theta;
    v = (v + t[3*n + i]) * rest;
    v = (v + t[2*n + i]) * theta;
    v = (v + t[n + i]) * rest;
    v = (v + t[i]) * theta;
    y[i] = v + s->x[i];
  }
}

int lmoc_dop853_shows(const lmoc_steps *s) { return s->reached < s->outputs && s->times[s->reached] <= s->t; }

/* The states at the output times that the last step has reached. Returns whether there was room for them. */
static int output(lmoc_steps *s) {
  const int64_t n = s->call->n;
  if (!lmoc_dop853_shows(s)) return 1;
  lmoc_dop853_dense(s);
  for (; lmoc_dop853_shows(s); s->reached++) {
    if (s->reached == s->room) return 0;
    lmoc_dop853_within(s, (s->times[s->reached] - s->before) / s->length, s->out + s->reached*n);
  }
  return 1;
}

/* Stand at the end of the last step, or at where it has been moved. */
static void go_on(lmoc_steps *s) {
  const int64_t n = s->call->n;
  const int moved = s->hook && s->hook->land;
  s->pending = 0;
  memcpy(s->x, moved ? s->landed : s->x_new, n * sizeof(double));
  if (!moved) {
    memcpy(s->f, s->k + 12*n, n * sizeof(double));
    return;
  }
  lmoc_derivatives(s->call, s->t, s->x, s->f);
  s->evaluations++;
}

void lmoc_dop853_afresh(lmoc_steps *s) { s->steps = s->rejected = s->evaluations = s->reached = 0; }

int lmoc_dop853_arrive(lmoc_steps *s) {
  if (s->pending) {
    if (!output(s)) return 1;
    go_on(s);
  }
  return s->steps + s->rejected >= s->most || s->t >= s->end;
}

int lmoc_dop853_walk(lmoc_steps *s) {
  int found = 0;
  lmoc_dop853_afresh(s);
  while (!lmoc_dop853_arrive(s) && !found) {
    found = attempt(s);
    if (found) return found;
    if (!is_certain(s)) return LMOC_DOUBTFUL;
    found = lmoc_dop853_accept(s);
  }
  return found;
}

int lmoc_dop853_begin(lmoc_steps *s, double first) {
  const int64_t n = s->call->n;
  const double span = s->end - s->t;
  double check = 0;
  s->cuts_since = s->t;
  s->length = s->error = s->stiffness = s->stiff_count = s->calm_count = s->careful = s->cuts = 0;
  lmoc_dop853_restart(s);
  s->evaluations = 1;
  for (int64_t i = 0; i < n; i++) check += s->f[i] * 0;
  s->step_size = first;
  if (check != 0 || first < INFINITY) return check == 0;
  const double h = lmoc_first_trial(n, span, s->max_step, lmoc_dop853_least(s), s->rtol, s->atol, s->x, s->f);
  for (int64_t i = 0; i < n; i++) s->x_new[i] = s->x[i] + h*s->f[i];
  lmoc_derivatives(s->call, s->t + h, s->x_new, s->k);
  s->evaluations = 2;
  s->step_size = lmoc_first_step(n, h, span, s->rtol, s->atol, s->x, s->f, s->k);
  return 1;
}

void lmoc_dop853_restart(lmoc_steps *s) {
  s->before = s->t;
  s->pending = s->staged = s->lost = 0;
  s->grow = s->rules->grow;
  lmoc_derivatives(s->call, s->t, s->x, s->f);
}
