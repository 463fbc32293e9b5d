/* Transitions (`transition.h`): impacts, the end of bounces, and the laws that could be closed. */

#include "transition.h"
#include "impact.h"
#include "jenkins.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double AT_ONCE = 1e-10;      /* s; gaps that would close within that time close together */
static const double TOUCHING = 1e-14;     /* gaps below this share of the lengths that make them are zero */
static const double TURNING = 1e-8;       /* s; a velocity that its accelerations undo in that time has come to zero by
                                             itself, not by a jump */
static const double BOUNCES_LEFT = 1e-9;  /* s; where all bounces to come would take less, they are over ... */
static const double LEAST_HEIGHT = 1e-14; /* ... as where they are lower than this share of the lengths that make the gap */
static const double RESOLVED = 1e3;       /* ... or than this many errors that the integrator allows itself (where that is a
                                             guess: and it does not let them get lower) ... */
static const double TOGETHER = 1e4;       /* ... or as this many where gaps that cannot be told from zero close among bounces
                                             without loss */
static const double UNSEEN = 3;           /* roots at which a gap closes again at once where it has just left: the hop is over */
static const double HOLDS = 1e-6;         /* share of what a law alone would have to hold: beyond it a force is none of
                                             rounding */

/* An instant that is being decided. */
typedef struct {
  const lmoc_kinematics *k;
  const lmoc_flag *closed;
  const lmoc_trigger *trigger;
  lmoc_changed *found;
  lmoc_contact before, now, spare;
  lmoc_impact *impact, *further;
  lmoc_settled trial;
  int64_t n;
  double *memory, *least, *lowest, *restitution, *share;
  int64_t *directions, *at_limit, *turns;
  lmoc_flag *flags, *holding, *touching, *striking, *sharing, *candidate, *one, *other, *releasing, *limits;
} decision;

/* The next instant takes the place of the present one. */
static void step_on(decision *d) {
  const lmoc_contact kept = d->now;
  d->now = d->spare;
  d->spare = kept;
}

static void raise_least(decision *d) {
  for (int64_t i = 0; i < d->n; i++) d->least[i] = fmax(d->least[i], lmoc_least_rate(&d->now, d->n, i));
}

/* ------------------------------------------------------------------ what could be closed */

/* Rates that are what the location of a root leaves of zero. */
static int turns(const decision *d, int64_t i) {
  const lmoc_contact *now = &d->now;
  return fabs(now->rate[i]) <= LMOC_STILL * now->rate_scale[i] + TURNING * lmoc_acceleration(now, d->n, i);
}

static int about_to_close(const decision *d, int64_t i) {
  return d->now.gap[i] <= TOUCHING * d->now.gap_scale[i] - AT_ONCE * fmin(d->now.rate[i], 0);
}

/* Laws that could be closed without a jump. */
static void candidates(const decision *d, const lmoc_flag *touching, lmoc_flag *out) {
  for (int64_t i = 0; i < d->n; i++) {
    const int reached = touching[i] || !d->k->unilateral[i];
    const int64_t degree = d->k->laws.degree[i];
    out[i] = degree == 0 || (reached && (degree == 1 || (degree == LMOC_POSITION && fabs(d->now.rate[i]) <= d->least[i])));
  }
}

/* Directions of friction that slides: as it moves or, just set free, as its last force has pulled. */
static const int64_t *sliding(const decision *d, const lmoc_flag *candidate) {
  for (int64_t i = 0; i < d->n; i++) {
    const int slides = !d->k->laws.complementary[i] && !candidate[i] && d->k->laws.degree[i] != LMOC_JENKINS;
    const double rate = d->now.rate[i];
    d->directions[i] = !slides ? 0 : d->trigger->opening[i] ? d->trigger->direction[i] : (rate > 0) - (rate < 0);
  }
  return d->directions;
}

static int settle(const decision *d, const lmoc_flag *candidate, const int64_t *at_limit, const lmoc_flag *opening,
                  lmoc_settled *found) {
  const lmoc_levels levels = {d->now.bias, d->now.delassus, d->now.slip, d->now.stick};
  return lmoc_settle(&d->k->laws, &levels, d->closed, candidate, sliding(d, candidate), at_limit, opening, found);
}

/* The levels to which the forces lead that act while these laws are the candidates. */
static int levels(decision *d, const lmoc_flag *candidate) {
  memset(d->at_limit, 0, (size_t)d->n * sizeof(int64_t));
  const int failed = settle(d, candidate, d->at_limit, 0, &d->trial);
  if (failed == LMOC_NO_FORCES) memcpy(d->found->settled.laws, d->trial.laws, (size_t)d->n);
  return failed;
}

/* ------------------------------------------------------------------ impacts */

/* Rates that are zero behind impulses that cancel, such as those that a body at rest passes on. */
static void raise_by_impulses(decision *d) {
  const lmoc_impact *own = d->impact;
  for (int64_t i = 0; i < d->n; i++) {
    double sum = 0;
    for (int64_t j = 0; j < own->count; j++) sum += fabs(d->before.delassus[i * d->n + own->which[j]] * own->impulse[j]);
    d->least[i] = fmax(d->least[i], LMOC_STILL * sum);
  }
}

static int strike(decision *d, const double *restitution) {
  const int failed = lmoc_strike(d->k, &d->before, d->sharing, d->closed, restitution, d->impact, d->found->settled.laws);
  if (failed) return failed;
  const int lost = lmoc_behind(d->k, &d->before, d->impact, &d->spare);
  step_on(d);
  return lost;
}

static int comes_back_below(const decision *d, int64_t i, double height) {
  const double level = d->trial.level[i], rate = d->now.rate[i];
  return level < 0 && rate * rate <= -2 * level * height;
}

static int comes_back_low(const decision *d, int64_t i, double times) { return comes_back_below(d, i, times * d->lowest[i]); }

/* Whether a low hop does not get lower than the last one, by at least half of what its impact takes: then the errors of
   the integrator keep it up, and will do so for ever. */
static int is_kept_up(const decision *d, int64_t i) {
  const double e = d->k->restitution[i], left = d->trigger->left[i], rate = d->now.rate[i];
  return left > 0 && rate * rate > left * left * (1 + e*e) / 2;
}

static int is_too_low(const decision *d, int64_t i) {
  return comes_back_below(d, i, LEAST_HEIGHT * d->now.gap_scale[i]) ||
         (comes_back_low(d, i, 1) && (!d->k->guessed || is_kept_up(d, i)));
}

static double to_come(const decision *d, int64_t i) {
  return 2 * d->now.rate[i] / (-d->trial.level[i] * (1 - d->k->restitution[i]));
}

static int touches_taking(const decision *d, int64_t i) {
  for (int64_t j = 0; j < d->n; j++)
    if (d->striking[j] && !lmoc_is_lossless(d->k, j) && d->now.delassus[i * d->n + j] != 0) return 1;
  return 0;
}

/* Laws that have bounced for the last time, and when all their further bounces would be over.

   A law that leaves with rate r under an acceleration -a comes back after 2r/a; all further bounces together take
   2r/(a(1 - e)). One of e = 1 bounces for ever alone; beside one that takes energy, as a ball on another one on a steel
   floor, all bounces tend to rest together: when their heights are no longer told from zero, neither are the gaps. */
static int bounces_over(decision *d, int *some) {
  const lmoc_kinematics *k = d->k;
  lmoc_flag *leaving = d->one, *rest = d->other, *over = d->found->accumulated;
  int bounce = 0, elastic = 0, failed;
  *some = 0;
  for (int64_t i = 0; i < d->n; i++) {
    leaving[i] = d->striking[i] && d->now.rate[i] > d->least[i];
    rest[i] = d->striking[i] && !leaving[i];
    bounce |= leaving[i] && d->trigger->closing[i] && k->restitution[i] > 0;
  }
  if (!bounce) return LMOC_SOLVED;
  candidates(d, rest, d->candidate);
  if ((failed = levels(d, d->candidate))) return failed;
  for (int64_t i = 0; i < d->n; i++) {
    const double level = d->trial.level[i], left = to_come(d, i);
    const int own = leaving[i] && d->trigger->closing[i];
    elastic |= own && lmoc_is_lossless(d->k, i) && touches_taking(d, i) && comes_back_low(d, i, TOGETHER);
    const int low = left < BOUNCES_LEFT || is_too_low(d, i);
    over[i] = own && k->restitution[i] > 0 && !lmoc_is_lossless(d->k, i) && level < 0 && low;
    if (over[i]) d->found->until = fmax(d->found->until, d->now.time + left);
  }
  for (int64_t i = 0; i < d->n; i++) {
    over[i] |= elastic && leaving[i] && comes_back_low(d, i, TOGETHER);
    *some |= over[i];
  }
  return LMOC_SOLVED;
}

/* Bring laws to rest, beside those that are; what that takes. */
static int to_rest(decision *d, lmoc_flag *which, double *energy) {
  int failed;
  for (int64_t i = 0; i < d->n; i++)
    which[i] |= lmoc_is_impulsive(d->k, i) && d->touching[i] && fabs(d->now.rate[i]) <= d->least[i];
  if ((failed = lmoc_rest(d->k, &d->now, which, d->further))) return failed;
  for (int64_t j = 0; j < d->further->count; j++)
    *energy -= 0.5 * d->further->impulse[j] * d->now.rate[d->further->which[j]];
  if ((failed = lmoc_behind(d->k, &d->now, d->further, &d->spare))) return failed;
  step_on(d);
  raise_least(d);
  return LMOC_SOLVED;
}

/* Laws that have just left, and have closed again and again since no faster than that, as if they had not come back: the
   integrator makes a step over the whole hop, however it begins. They have bounced for the last time. */
static int unseen(decision *d) {
  lmoc_flag *ends = d->one, *rest = d->other, *over = d->found->accumulated;
  int some = 0, failed;
  double energy = 0;
  for (int64_t i = 0; i < d->n && d->k->guessed; i++) {
    const int leaves = d->touching[i] && d->trigger->closing[i] && d->now.rate[i] > d->least[i];
    const double left = d->trigger->left[i];
    const int again = d->trigger->idle[i] >= UNSEEN && d->now.rate[i] < 1.01 * left;
    ends[i] = leaves && again && lmoc_is_impulsive(d->k, i) && !lmoc_is_lossless(d->k, i);
    rest[i] = d->touching[i] && !ends[i];
    some |= ends[i];
  }
  if (!some) return LMOC_SOLVED;
  candidates(d, rest, d->candidate);
  if ((failed = levels(d, d->candidate))) return failed;
  some = 0;
  for (int64_t i = 0; i < d->n; i++) {
    some |= over[i] = ends[i] = ends[i] && d->trial.level[i] < 0;
    if (over[i]) d->found->until = fmax(d->found->until, d->now.time + to_come(d, i));
  }
  if (!some) return LMOC_SOLVED;
  if ((failed = to_rest(d, ends, &energy))) return failed;
  for (int64_t i = 0; i < d->n; i++)
    if (over[i]) {
      d->found->lost[i] = energy;
      energy = 0;
    }
  return LMOC_SOLVED;
}

/* Closed laws that an impact opens by a gap that cannot be told from zero, before they close again, are brought to rest:
   two strings without restitution may throw each other open in turn, ever shorter, which ends with both of them taut. */
static int thrown_for_nothing(decision *d, double *energy) {
  lmoc_flag *thrown = d->one, *rest = d->other;
  int some = 0, failed;
  for (int64_t i = 0; i < d->n; i++) {
    thrown[i] = d->touching[i] && lmoc_is_impulsive(d->k, i) && d->closed[i] && d->now.rate[i] > d->least[i];
    rest[i] = d->touching[i] && !thrown[i];
    some |= thrown[i];
  }
  if (!some) return LMOC_SOLVED;
  candidates(d, rest, d->candidate);
  for (int64_t i = 0; i < d->n; i++) d->candidate[i] &= !thrown[i];
  if ((failed = levels(d, d->candidate))) return failed;
  some = 0;
  for (int64_t i = 0; i < d->n; i++) some |= thrown[i] = thrown[i] && comes_back_low(d, i, 1);
  return some ? to_rest(d, thrown, energy) : LMOC_SOLVED;
}

/* All impulses at the instant. `energy`: what those further impacts take that come to nothing. */
static int impulses(decision *d, double *energy) {
  const lmoc_kinematics *k = d->k;
  int failed, over;
  if ((failed = strike(d, k->restitution))) return failed;
  raise_least(d);
  raise_by_impulses(d);
  for (int64_t i = 0; i < d->n; i++) {
    const double *slope = d->now.slope + i * k->states;
    double errors = 0;
    for (int64_t j = 0; j < k->states; j++) errors += fabs(slope[j]) * k->unresolved[j];
    d->lowest[i] = fmax(LEAST_HEIGHT * d->now.gap_scale[i], RESOLVED * errors);
  }
  if ((failed = bounces_over(d, &over))) return failed;
  for (int64_t i = 0; i < d->n; i++) d->restitution[i] = d->found->accumulated[i] ? 0 : k->restitution[i];
  if (over && (failed = strike(d, d->restitution))) return failed;
  raise_least(d);
  return thrown_for_nothing(d, energy);
}

/* The laws of an impact that would have another outcome if they were hit one after the other. */
static void undecided(decision *d) {
  const lmoc_impact *own = d->impact;
  const int64_t m = own->count;
  int64_t hit = 0, blocked = 0;
  for (int64_t i = 0; i < m; i++) hit += own->impulse[i] != 0;
  for (int64_t i = 0; i < d->n; i++) blocked += d->found->accumulated[i] || (d->sharing[i] && d->k->laws.contact[i]);
  if (hit < 2 || blocked) return;
  double *matrix = d->share, *rate = matrix + m*m, *e = rate + m;
  for (int64_t i = 0; i < m; i++) {
    for (int64_t j = 0; j < m; j++) matrix[i*m + j] = d->before.delassus[own->which[i] * d->n + own->which[j]];
    rate[i] = d->before.rate[own->which[i]];
    e[i] = d->k->restitution[own->which[i]];
  }
  if (lmoc_depends_on_order(m, matrix, rate, e, own->rate))
    for (int64_t i = 0; i < m; i++) d->found->undecided[own->which[i]] = own->impulse[i] != 0;
}

/* What each law has passed on, and what it has cost. What friction takes counts as its contact's, what all later impacts
   take as this one's. */
static void account(decision *d, double energy) {
  const lmoc_impact *own = d->impact;
  lmoc_changed *f = d->found;
  int64_t hardest = 0;
  for (int64_t i = 0; i < own->count; i++) {
    f->impulse[own->which[i]] = own->impulse[i];
    f->lost[own->which[i]] = own->lost[i];
  }
  for (int64_t i = 0; i < d->n; i++) if (f->impulse[i] > f->impulse[hardest]) hardest = i;
  f->lost[hardest] += energy;
  for (int64_t i = 0; i < d->n; i++) {
    if (!d->sharing[i] || !d->k->laws.contact[i]) continue;
    f->lost[d->k->laws.normal[i]] += f->lost[i];
    f->impulse[i] = f->lost[i] = 0;
  }
  undecided(d);
}

/* ------------------------------------------------------------------ the next mode */

/* A force that has come to zero by itself is zero up to rounding, and its law opens. Where other laws open at the same
   instant it may have to hold after all: as of two that a jump of a load has set free. */
static int next_mode(decision *d) {
  const lmoc_settled *trial = &d->trial;
  int64_t releasing = 0, held = 0;
  for (int64_t i = 0; i < d->n; i++) {
    d->at_limit[i] = d->trigger->opening[i] ? d->trigger->direction[i] : 0;
    d->releasing[i] = d->trigger->opening[i] && !d->k->laws.dry[i] && d->candidate[i];
    releasing += d->releasing[i];
    held += d->closed[i];
  }
  if (releasing && held > 1) {
    const int failed = settle(d, d->candidate, d->at_limit, 0, &d->trial);
    if (failed && failed != LMOC_NO_FORCES) return failed;
    for (int64_t i = 0; i < d->n && !failed; i++) {
      const double alone = fabs(d->now.bias[i] / d->now.delassus[i * d->n + i]);
      const int holds = trial->closed[i] && trial->unique[i] && trial->force[i] > HOLDS * (alone == alone ? alone : 0);
      d->releasing[i] &= !holds;
    }
  }
  for (int64_t i = 0; i < d->n; i++) d->other[i] = d->candidate[i] && !d->releasing[i];
  return settle(d, d->other, d->at_limit, d->releasing, &d->found->settled);
}

static int without_rounding(decision *d) {
  int some = 0;
  for (int64_t i = 0; i < d->n; i++) some |= d->one[i] = d->candidate[i] && d->k->unilateral[i];
  if (!some || !d->k->exact) return LMOC_SOLVED;
  return d->k->exact(d->k->owner, d->now.time, d->now.x, d->one, d->now.bias) ? LMOC_HELD_UP : LMOC_SOLVED;
}

/* Onto what the mode keeps closed. */
static int onto_closed(decision *d) {
  const lmoc_settled *s = &d->found->settled;
  for (int64_t i = 0; i < d->n; i++) {
    const int64_t degree = d->k->laws.degree[i];
    d->one[i] = s->closed[i] && d->k->unilateral[i] && degree >= 1;
    d->other[i] = s->closed[i] && degree == LMOC_POSITION;
  }
  return lmoc_project(d->k, d->one, d->other, &d->now, &d->spare, s->laws);
}

/* ------------------------------------------------------------------ all of it */

/* What is closed or closing touches; what strikes. Returns whether anything closes with a velocity. */
static int begin(decision *d, int *strikes) {
  const lmoc_kinematics *k = d->k;
  const lmoc_trigger *t = d->trigger;
  for (int64_t i = 0; i < d->n; i++) {
    const int64_t degree = k->laws.degree[i];
    const int turning = turns(d, i);
    d->holding[i] = d->closed[i] && (turning || !t->jumped);
    d->touching[i] = k->unilateral[i] && degree >= 1 && (d->closed[i] || t->closing[i] || about_to_close(d, i));
    const int at_rest = d->holding[i] || (t->closing[i] && turning);
    /* up to what integration leaves of zero: no impact */
    d->other[i] = ((at_rest && !k->unilateral[i]) || d->holding[i]) && degree == LMOC_POSITION;
  }
  const int failed = lmoc_project(k, d->touching, d->other, &d->now, &d->spare, d->found->settled.laws);
  if (failed) return failed;
  *strikes = 0;
  for (int64_t i = 0; i < d->n; i++) {
    d->striking[i] = lmoc_is_impulsive(k, i) && (d->touching[i] || !k->unilateral[i]); /* an open ratchet may be driven back */
    d->least[i] = lmoc_least_rate(&d->now, d->n, i);
    *strikes |= d->striking[i] && d->now.rate[i] < -d->least[i];
  }
  lmoc_sharing(k, d->striking, d->sharing);
  return LMOC_SOLVED;
}

static int decide(decision *d, double time, const double *x) {
  const lmoc_kinematics *k = d->k;
  lmoc_changed *f = d->found;
  double energy = 0;
  int failed, strikes;
  f->law = -1;
  f->until = -INFINITY;
  for (int64_t i = 0; i < d->n; i++) {
    f->impulse[i] = f->lost[i] = 0;
    f->accumulated[i] = f->undecided[i] = 0;
  }
  if ((failed = lmoc_contact_at(k, time, x, &d->now)) || (failed = begin(d, &strikes))) return failed;
  lmoc_contact_copy(d->n, k->states, &d->now, &d->before);
  if ((failed = strikes ? impulses(d, &energy) : unseen(d))) return failed;
  for (int64_t i = 0; i < d->n && !strikes; i++) /* what has been closed is at rest, however slow the scene */
    if (d->holding[i]) d->least[i] = INFINITY;
  if (strikes) {
    f->law = d->impact->law;
    account(d, energy);
  }
  if ((failed = lmoc_jenkins_relax(k, d->closed, d->trigger->opening, d->trigger->direction, &d->now, &d->spare, d->impact,
                                   d->limits, f->lost, f->settled.laws)))
    return failed;
  candidates(d, d->touching, d->candidate);
  if ((failed = without_rounding(d)) || (failed = next_mode(d))) return failed;
  for (int64_t i = 0; i < d->n; i++)
    f->touched[i] = d->touching[i] || (d->candidate[i] && !k->unilateral[i]) || k->laws.degree[i] == LMOC_JENKINS;
  if ((failed = onto_closed(d))) return failed;
  f->stored = *d->before.stored;
  lmoc_contact_copy(d->n, k->states, &d->now, f->now);
  return lmoc_jenkins_decide(k, &d->now, &d->spare, d->impact, d->limits, &f->settled);
}

/* Memory of a decision; 0 where there is none. */
static int make(decision *d) {
  const int64_t n = d->n, size = lmoc_contact_size(n, d->k->states);
  double *m = d->memory = malloc((size_t)(3*size + n*n + 8*n + 1) * sizeof(double));
  int64_t *i = d->directions = malloc((size_t)(3*n + 1) * sizeof(int64_t));
  lmoc_flag *f = d->flags = malloc((size_t)(13*n) + 1);
  d->impact = lmoc_impact_new(n);
  d->further = lmoc_impact_new(n);
  if (!m || !i || !f || !d->impact || !d->further) return 0;
  lmoc_contact_place(n, d->k->states, m, &d->before);
  lmoc_contact_place(n, d->k->states, m + size, &d->now);
  lmoc_contact_place(n, d->k->states, m + 2*size, &d->spare);
  m += 3*size;
  d->least = m, d->lowest = m + n, d->restitution = m + 2*n;
  d->at_limit = i + n;
  d->trial = (lmoc_settled){f, f + n, f + 2*n, f + 3*n, i + 2*n, m + 3*n, m + 4*n, m + 5*n};
  d->share = m + 6*n;
  lmoc_flag **masks[] = {&d->holding, &d->touching, &d->striking, &d->sharing, &d->candidate, &d->one, &d->other, &d->releasing,
                         &d->limits};
  for (int at = 0; at < 9; at++) *masks[at] = f + (4 + at) * n;
  return 1;
}

static void drop(decision *d) {
  free(d->memory);
  free(d->directions);
  free(d->flags);
  lmoc_impact_free(d->impact);
  lmoc_impact_free(d->further);
}

int lmoc_transition(const lmoc_kinematics *k, double time, const double *x, const lmoc_flag *closed,
                    const lmoc_trigger *trigger, lmoc_changed *found) {
  decision d = {.k = k, .closed = closed, .trigger = trigger, .found = found, .n = k->laws.count};
  const int status = make(&d) ? decide(&d, time, x) : LMOC_NO_MEMORY;
  drop(&d);
  return status;
}
