/* Laws that switch (`law_run.h`): the bookkeeping around transitions. */

#include "law_run.h"
#include "manifold.h"
#include "strike.h"
#include "switching.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double AT_ONCE = 1e-10;   /* s behind the start within which a law opens as the run begins */
static const double ROUNDING = 1e-13;  /* share of the forces that hold a body by which they may miss each other */
static const double OVERLAP = 1e-8;    /* a gap is negative where it is by this share of the lengths of the scene … */
static const double OVERLAP_ROUNDING = 1e-12; /* … and by more than what start values may be wrong by that are differences */
enum { ROUNDS = 20 };                  /* of laws and discrete equations that change each other at one instant */

/* ------------------------------------------------------------------ memory */

int64_t lmoc_law_place(lmoc_law_run *s, double *memory) {
  const int64_t n = s->k.laws.count, m = s->k.states, size = lmoc_contact_size(n, m);
  int64_t total = 0;
  double *contact;
#define TAKE(name, count) (s->name = memory ? (void *)(memory + total) : 0, total += (count))
#define FLAGS(name, count) TAKE(name, ((count) + 7) / 8)
  TAKE(times, (int64_t)(sizeof(lmoc_law_times) / sizeof(double)));
  TAKE(direction, n); TAKE(push, n); TAKE(force, n); TAKE(idle, n); TAKE(rounding, m); TAKE(forms, n * m);
  TAKE(impacts, n * LMOC_SERIES); TAKE(changes, LMOC_CHANGES); TAKE(left, n); TAKE(apart, 2*n); TAKE(turning, n);
  FLAGS(opening, n); FLAGS(closing, n); FLAGS(closed, n); FLAGS(implied, n); FLAGS(touched, n); FLAGS(held, m);
  TAKE(kind, n); TAKE(when, n); TAKE(impulse, n); TAKE(lost, n); TAKE(level, n);
  FLAGS(was, n); FLAGS(is, n); FLAGS(passing, n); FLAGS(accumulated, n); FLAGS(undecided, n); FLAGS(laws, n);
  lmoc_contact *at[] = {&s->now, &s->past, &s->spare};
  for (int i = 0; i < 3; i++, total += size) {
    contact = memory ? memory + total : 0;
    if (memory) lmoc_contact_place(n, m, contact, at[i]);
  }
  TAKE(next.direction, n); TAKE(next.push, n); TAKE(next.force, n); TAKE(root, 2*n); TAKE(inputs, 6*n);
  FLAGS(next.closed, n); FLAGS(next.implied, n); FLAGS(next.unique, n); FLAGS(none, 2*n);
#undef TAKE
#undef FLAGS
  s->next.level = s->level;
  s->next.laws = s->laws;
  return total;
}

void lmoc_law_open(lmoc_law_run *s) {
  const int64_t n = s->k.laws.count;
  *s->times = (lmoc_law_times){-INFINITY, -INFINITY, -INFINITY, 0};
  for (int64_t i = 0; i < n; i++) {
    s->direction[i] = s->turning[i] = s->kind[i] = 0;
    s->push[i] = s->force[i] = s->idle[i] = s->left[i] = s->apart[i] = s->apart[n + i] = 0;
    s->closed[i] = s->implied[i] = s->touched[i] = s->opening[i] = s->closing[i] = 0;
  }
  for (int64_t i = 0; i < n * LMOC_SERIES; i++) s->impacts[i] = NAN;
  for (int64_t i = 0; i < s->k.states; i++) s->rounding[i] = s->held[i] = 0;
  memset(s->none, 0, (size_t)(2*n));
}

/* ------------------------------------------------------------------ what goes with a mode */

static int is_gap(const lmoc_law_run *s, int64_t i) { return s->k.unilateral[i] && s->k.laws.degree[i] >= 1; }

int lmoc_law_renew(lmoc_law_run *s) {
  const int64_t n = s->k.laws.count, m = s->k.states;
  int some = 0, failed;
  for (int64_t i = 0; i < n; i++) {
    some |= s->linear[i];
    for (int64_t j = 0; j < m; j++) s->forms[i*m + j] = NAN;
  }
  if (!some) return LMOC_SOLVED;
  memset(s->spare.x, 0, (size_t)m * sizeof(double));
  if ((failed = lmoc_contact_at(&s->k, 0, s->spare.x, &s->spare))) return failed;
  for (int64_t i = 0; i < n; i++) {
    const double *slope = s->spare.slope + (n + i) * m;
    int of_velocities = s->linear[i] && s->spare.rate[i] == 0 && s->k.laws.degree[i] == LMOC_POSITION;
    for (int64_t j = 0; j < m; j++) of_velocities &= !(s->position[j] && slope[j] != 0);
    if (of_velocities) memcpy(s->forms + i*m, slope, (size_t)m * sizeof(double));
  }
  return LMOC_SOLVED;
}

static int hold(lmoc_law_run *s) {
  const int64_t n = s->k.laws.count, m = s->k.states;
  double *rows = malloc((size_t)(n * m + 1) * sizeof(double));
  int64_t count = 0;
  if (!rows) return LMOC_NO_MEMORY;
  for (int64_t i = 0; i < n; i++)
    if (s->closed[i]) memcpy(rows + m * count++, s->forms + i*m, (size_t)m * sizeof(double));
  const int found = lmoc_held_velocities(count, m, rows, s->held);
  free(rows);
  return found;
}

static void note_rounding(lmoc_law_run *s) {
  const int64_t n = s->k.laws.count;
  for (int64_t j = 0; j < s->k.states; j++) {
    double sum = 0;
    for (int64_t i = 0; i < n; i++) sum += fabs(s->now.response[j*n + i]) * fabs(s->force[i]);
    s->rounding[j] = ROUNDING * sum;
  }
}

void lmoc_law_inputs(const lmoc_law_run *s, double *out) {
  const lmoc_settled mode = {.closed = s->closed, .implied = s->implied, .direction = s->direction, .push = s->push};
  for (int64_t i = 0; i < 3 * s->k.laws.count; i++) out[i] = lmoc_mode_input(&mode, s->k.laws.count, i);
}

/* ------------------------------------------------------------------ what ends a mode */

static lmoc_switching switching(const lmoc_law_run *s) {
  return (lmoc_switching){s->k.laws, s->k.states, s->k.unilateral, s->curved, s->limits, s->noise, s->closed, s->implied,
                          s->direction, s->touched, s->idle};
}

int64_t lmoc_law_values(const lmoc_law_run *s, int64_t count, const double *read, double *out) {
  const lmoc_switching own = switching(s);
  return lmoc_law_roots(&own, count, read, s->apart, out);
}

void lmoc_law_watch(lmoc_law_run *s, const double *read) {
  const lmoc_switching own = switching(s);
  lmoc_law_roots(&own, 1, read, 0, s->root);
  lmoc_law_apart(&own, &s->now, s->k.errors, s->root, s->apart);
}

/* ------------------------------------------------------------------ gaps that are not zero */

/* By what gaps may miss zero, or overlap. */
static double allowed(const lmoc_law_run *s, const lmoc_contact *at, int64_t i) {
  double most = 0, drifted = 0;
  for (int64_t j = 0; j < s->k.laws.count; j++) if (is_gap(s, j)) most = fmax(most, at->gap_scale[j]);
  if (s->closed[i]) lmoc_drift(1, s->k.states, at->slope + i * s->k.states, s->k.errors, &drifted);
  return fmax(OVERLAP * most + OVERLAP_ROUNDING, drifted);
}

/* Closed laws whose gaps are no longer zero: a jump of the states, or of an input, opens them. */
static int is_apart(const lmoc_law_run *s, const lmoc_contact *at, int64_t i) {
  return s->closed[i] && is_gap(s, i) && at->gap[i] > allowed(s, at, i);
}

/* Say of the first gap that it is negative though no motion has closed it: start values or a jump have put it there, and
   states that are moved back would differ from those requested. */
static int overlaps(lmoc_law_run *s, const lmoc_contact *at, int jumped) {
  const int64_t n = s->k.laws.count;
  for (int64_t i = 0; i < n; i++) {
    const int moved = is_gap(s, i) && (jumped || !s->closed[i]) && !s->closing[i];
    if (!moved || !(at->gap[i] < -allowed(s, at, i))) continue;
    memset(s->laws, 0, (size_t)n);
    s->laws[i] = 1;
    return 1;
  }
  return 0;
}

/* ------------------------------------------------------------------ what an instant is for each law */

/* When the bounces of a law are over that ends them now. Without loss of its own they do so with those of others, ever
   faster: the times between them are a geometric series (Aitken's extrapolation). */
static double end_of_bounces(const lmoc_law_run *s, int64_t i, double time) {
  const double *at = s->impacts + i * LMOC_SERIES, first = at[1] - at[0], second = at[2] - at[1];
  if (!lmoc_is_lossless(&s->k, i) || !(first == first)) return fmax(time, s->until);
  return second > 0 && second < first ? time + second*second / (first - second) : time;
}

static int kind_of(const lmoc_law_run *s, int64_t i, int alone, int at_start) {
  const int was = s->was[i], is = s->is[i], turned = s->direction[i] * s->next.direction[i] < 0;
  if (s->accumulated[i]) return LMOC_ACCUMULATION;
  if (was == is && !turned) return s->impulse[i] == 0 || (was && is && !alone) ? LMOC_NO_EVENT : LMOC_IMPACT;
  if (at_start && s->impulse[i] == 0) return LMOC_NO_EVENT; /* how it begins is no event */
  return is ? LMOC_CLOSING : LMOC_OPENING;
}

static int is_shown(const lmoc_flag *closed, const lmoc_flag *implied, const int64_t *direction, int64_t i) {
  return closed[i] || (implied[i] && direction[i] == 0);
}

/* Tell what has happened, before the new mode takes the place of the old one. */
static void tell(lmoc_law_run *s, double time, int at_start) {
  const int64_t n = s->k.laws.count;
  int alone = 1; /* nobody else has been hit: what stays closed is the impact */
  s->some = 0;
  for (int64_t i = 0; i < n; i++) {
    s->was[i] = is_shown(s->closed, s->implied, s->direction, i);
    s->is[i] = is_shown(s->next.closed, s->next.implied, s->next.direction, i);
    s->passing[i] = s->was[i] && s->is[i] && !s->accumulated[i] && s->impulse[i] != 0;
    if (s->impulse[i] != 0) {
      memmove(s->impacts + i * LMOC_SERIES, s->impacts + i * LMOC_SERIES + 1, (LMOC_SERIES - 1) * sizeof(double));
      s->impacts[(i + 1) * LMOC_SERIES - 1] = time;
      alone &= s->passing[i];
      s->left[i] = fmax(s->now.rate[i], 0);
    }
  }
  for (int64_t i = 0; i < n; i++) {
    s->kind[i] = kind_of(s, i, alone, at_start);
    if (s->accumulated[i]) s->left[i] = 0;
    s->when[i] = s->accumulated[i] ? end_of_bounces(s, i, time) : time;
    s->passing[i] &= !alone;
    s->some |= s->kind[i] != LMOC_NO_EVENT;
  }
}

/* ------------------------------------------------------------------ what happens */

/* Energy that impacts take becomes heat, and what is stored has changed by their work. */
static void book(const lmoc_law_run *s, double stored, double *x) {
  double lost = 0;
  int some = 0;
  for (int64_t i = 0; i < s->k.laws.count; i++) {
    lost += s->lost[i];
    some |= s->impulse[i] != 0 || s->lost[i] != 0;
  }
  if (s->work < 0 || s->heat < 0 || !some) return;
  x[s->heat] += lost;
  x[s->work] += lost + *s->now.stored - stored;
}

static void take_mode(lmoc_law_run *s) {
  for (int64_t i = 0; i < s->k.laws.count; i++) {
    s->closed[i] = s->next.closed[i];
    s->implied[i] = s->next.implied[i];
    s->direction[i] = s->next.direction[i];
    s->push[i] = s->next.push[i];
    s->force[i] = s->next.force[i];
  }
}

/* Let the trigger have its consequences. */
static int take(lmoc_law_run *s, double time, double *x, int jumped, int at_start) {
  const int64_t n = s->k.laws.count, m = s->k.states;
  int failed;
  if ((failed = lmoc_contact_at(&s->k, time, x, &s->spare))) return failed;
  if (overlaps(s, &s->spare, jumped)) return LMOC_OVERLAPS;
  for (int64_t i = 0; i < n; i++) s->is[i] = s->closed[i] && !(jumped && is_apart(s, &s->spare, i));
  const lmoc_trigger trigger = {s->closing, s->opening, s->turning, jumped, s->left, s->idle};
  lmoc_changed found = {.settled = s->next, .now = &s->now, .impulse = s->impulse, .lost = s->lost, .touched = s->touched,
                        .accumulated = s->accumulated, .undecided = s->undecided};
  if ((failed = lmoc_transition(&s->k, time, x, s->is, &trigger, &found))) return failed;
  s->until = found.until;
  s->law = found.law;
  tell(s, time, at_start);
  take_mode(s);
  s->times->now = time;
  note_rounding(s);
  if ((failed = hold(s))) return failed;
  for (int64_t j = 0; j < m; j++) x[j] = s->held[j] ? 0 : s->now.x[j];
  book(s, found.stored, x);
  return LMOC_SOLVED;
}

int lmoc_law_start(lmoc_law_run *s, double time, double *x) {
  const int64_t n = s->k.laws.count;
  s->times->begun = time;
  memset(s->closing, 0, (size_t)n);
  memset(s->opening, 0, (size_t)n);
  memset(s->turning, 0, (size_t)n * sizeof(int64_t));
  return take(s, time, x, 0, 1);
}

/* Take the laws that have opened at the same time before into the trigger. Nothing has moved since then: a friction would
   stick again, since its force is still within its limits up to rounding. */
static void trigger_by(lmoc_law_run *s, double time, const lmoc_flag *which) {
  const int64_t n = s->k.laws.count;
  const int again = time == s->times->let_go;
  for (int64_t i = 0; i < n; i++) {
    const int first = which[i], second = which[n + i], closing = first && !s->closed[i];
    /* Jenkins friction has given way already */
    const int still = again && s->opening[i] && !s->closed[i] && !closing && s->k.laws.degree[i] != LMOC_JENKINS;
    s->closing[i] = closing;
    s->opening[i] = ((first || second) && s->closed[i]) || still;
    if (!still) s->turning[i] = first ? -1 : 1; /* a force at its upper limit gives way to a motion against it */
  }
  s->times->let_go = time;
}

/* Whether laws change again and again within a moment. */
static int chatters(lmoc_law_run *s, double time) {
  const int64_t k = s->times->changes++;
  s->changes[k % LMOC_CHANGES] = time;
  return k + 1 >= LMOC_CHANGES && time - s->changes[(k + 1) % LMOC_CHANGES] <= s->moment;
}

int lmoc_law_happen(lmoc_law_run *s, double time, double *x, const lmoc_flag *which, int jumped) {
  const int64_t n = s->k.laws.count;
  int some = 0;
  for (int64_t i = 0; i < 2*n; i++) some |= which[i];
  if (some && chatters(s, time)) {
    for (int64_t i = 0; i < n; i++) s->laws[i] = which[i] || which[n + i];
    return LMOC_CHATTERS;
  }
  for (int64_t i = 0; i < n; i++) s->root[i] = s->closed[i];
  trigger_by(s, time, which);
  /* a load that grows from zero opens a law in the first instant: that is how the run begins */
  const int at_start = !jumped && some && time - s->times->begun <= AT_ONCE;
  const int failed = take(s, time, x, jumped, at_start);
  if (failed) return failed;
  for (int64_t i = 0; i < n; i++) {
    const int idle = (which[i] || which[n + i]) && s->root[i] == s->closed[i] && !s->some;
    s->idle[i] = idle ? s->idle[i] + 1 : s->some ? 0 : s->idle[i];
  }
  return LMOC_SOLVED;
}

int lmoc_law_go_on(lmoc_law_run *s, double time, const double *x, int anew) {
  const int failed = lmoc_contact_at(&s->k, time, x, &s->now);
  if (failed) return failed;
  s->times->now = time;
  for (int64_t i = 0; i < s->k.laws.count && anew; i++)
    s->touched[i] = s->k.unilateral[i] ? s->now.gap[i] <= LMOC_STILL * s->now.gap_scale[i]
                                       : fabs(s->now.rate[i]) <= LMOC_STILL * s->now.rate_scale[i];
  note_rounding(s);
  return hold(s);
}

/* ------------------------------------------------------------------ steps of what is prescribed */

int lmoc_law_look(lmoc_law_run *s, double time, const double *x) { return lmoc_contact_at(&s->k, time, x, &s->past); }

int lmoc_law_parts(lmoc_law_run *s, double time, const double *x, int *found) {
  const lmoc_contact *now = &s->spare, *past = &s->past;
  const int failed = lmoc_contact_at(&s->k, time, x, &s->spare);
  *found = 0;
  for (int64_t i = 0; i < s->k.laws.count && !failed; i++) {
    const double change = now->gap[i] - past->gap[i], turn = now->rate[i] - past->rate[i];
    const int moved = s->closed[i] && s->k.unilateral[i] && fabs(change) > OVERLAP * fmax(now->gap_scale[i], past->gap_scale[i]);
    if (moved && change < 0) {
      memset(s->laws, 0, (size_t)s->k.laws.count);
      s->laws[i] = 1;
      return LMOC_GAP_JUMPS;
    }
    *found |= moved || fabs(turn) > LMOC_STILL * fmax(now->rate_scale[i], past->rate_scale[i]);
  }
  return failed;
}

int lmoc_law_strike(lmoc_law_run *s, double time, const double *before, double *x) {
  const int64_t n = s->k.laws.count, m = s->k.states;
  if (!memcmp(before, x, (size_t)m * sizeof(double))) return LMOC_SOLVED;
  const int failed = lmoc_contact_at(&s->k, time, x, &s->spare);
  if (failed) return failed;
  for (int64_t i = 0; i < n; i++) s->is[i] = s->closed[i] && !is_apart(s, &s->spare, i);
  memcpy(s->past.x, x, (size_t)m * sizeof(double));
  return lmoc_resisted(&s->k, time, s->past.x, s->is, x, s->laws);
}

/* ------------------------------------------------------------------ what stays closed */

static int gap_drifts(const lmoc_law_run *s, int64_t i) { return s->closed[i] && s->curved[i] && is_gap(s, i); }

static int rate_drifts(const lmoc_law_run *s, int64_t i) {
  return s->closed[i] && s->curved[s->k.laws.count + i] && s->k.laws.degree[i] == LMOC_POSITION;
}

int lmoc_law_drifts(const lmoc_law_run *s) {
  for (int64_t i = 0; i < s->k.laws.count; i++) if (gap_drifts(s, i) || rate_drifts(s, i)) return 1;
  return 0;
}

int lmoc_law_keep(lmoc_law_run *s, double time, double share, double *x) {
  const int64_t n = s->k.laws.count;
  const lmoc_contact *at = &s->past;
  int failed = lmoc_contact_at(&s->k, time, x, &s->past), off = 0;
  for (int64_t i = 0; i < n && !failed; i++) {
    s->was[i] = gap_drifts(s, i);
    s->is[i] = rate_drifts(s, i);
    off |= s->was[i] && !(fabs(at->gap[i]) <= share * at->gap_scale[i]);
    off |= s->is[i] && !(fabs(at->rate[i]) <= share * at->rate_scale[i]);
  }
  if (failed || !off) return failed;
  if ((failed = lmoc_project(&s->k, s->was, s->is, &s->past, &s->spare, s->laws))) return failed;
  memcpy(x, s->past.x, (size_t)s->k.states * sizeof(double));
  return LMOC_SOLVED;
}

/* ------------------------------------------------------------------ laws and discrete equations */

static int same(int64_t count, const double *one, const double *other) {
  for (int64_t i = 0; i < count; i++) if (one[i] != other[i]) return 0;
  return 1;
}

static int differ(const lmoc_law_run *s, const double *one, const double *other) {
  for (int64_t j = 0; j < s->k.states; j++) if (!s->k.ledger[j] && one[j] != other[j]) return 1;
  return 0;
}


int lmoc_law_settle(lmoc_law_run *s, const lmoc_discrete *d, double time, double *before, double *x) {
  const int64_t n = s->k.laws.count;
  int failed, parted;
  for (int round = 0; round < ROUNDS; round++) {
    if ((failed = lmoc_law_look(s, time, x))) return failed;
    if (d->renew(d->owner)) return LMOC_HELD_UP;
    if ((failed = lmoc_law_renew(s)) || (failed = lmoc_law_parts(s, time, x, &parted))) return failed;
    lmoc_law_inputs(s, s->inputs);
    if ((failed = lmoc_law_happen(s, time, x, s->none, parted || differ(s, before, x)))) return failed;
    memcpy(before, x, (size_t)s->k.states * sizeof(double));
    if (d->happened(d->owner)) return LMOC_HELD_UP;
    lmoc_law_inputs(s, s->inputs + 3*n);
    if (!s->some && same(3*n, s->inputs, s->inputs + 3*n)) return LMOC_SOLVED;
    if (d->settle(d->owner, time, x)) return LMOC_HELD_UP;
  }
  return LMOC_NO_END;
}
