/* Impulses of some of the laws of a scene, and the instant behind them. */

#include "strike.h"
#include "dense.h"
#include "impact.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double LOCATED = 1e-14;   /* s, or this share of the time: so exactly are instants located */
static const double LOSSLESS = 1e-6;   /* of a rate, in a bounce */

int lmoc_is_impulsive(const lmoc_kinematics *k, int64_t law) {
  return k->laws.complementary[law] && k->laws.degree[law] == LMOC_POSITION;
}

int lmoc_is_lossless(const lmoc_kinematics *k, int64_t law) { return k->restitution[law] > 1 - LOSSLESS; }

double lmoc_acceleration(const lmoc_contact *now, int64_t n, int64_t law) {
  const double held = now->delassus[law*n + law] * now->stick[law];
  return fabs(now->bias[law]) + (held * 0 == 0 ? held : 0);
}

double lmoc_least_rate(const lmoc_contact *now, int64_t n, int64_t law) {
  return LMOC_STILL * now->rate_scale[law] + LOCATED * fmax(1, fabs(now->time)) * lmoc_acceleration(now, n, law);
}

void lmoc_sharing(const lmoc_kinematics *k, const lmoc_flag *striking, lmoc_flag *sharing) {
  const lmoc_laws *l = &k->laws;
  for (int64_t i = 0; i < l->count; i++)
    sharing[i] = striking[i] || (l->contact[i] && l->degree[i] == LMOC_POSITION && striking[l->normal[i]]);
}

lmoc_impact *lmoc_impact_new(int64_t laws) {
  lmoc_impact *one = calloc(1, sizeof *one);
  if (!one) return 0;
  one->impulse = malloc((size_t)(3*laws + 1) * sizeof(double));
  one->which = malloc((size_t)(laws + 1) * sizeof(int64_t));
  if (!one->impulse || !one->which) {
    lmoc_impact_free(one);
    return 0;
  }
  one->rate = one->impulse + laws;
  one->lost = one->rate + laws;
  return one;
}

void lmoc_impact_free(lmoc_impact *one) {
  if (!one) return;
  free(one->impulse);
  free(one->which);
  free(one);
}

/* The matrix of the laws that take part. */
void lmoc_part_of(const lmoc_contact *now, int64_t n, const lmoc_impact *one, double *matrix) {
  for (int64_t i = 0; i < one->count; i++)
    for (int64_t j = 0; j < one->count; j++)
      matrix[i * one->count + j] = now->delassus[one->which[i]*n + one->which[j]];
}

static void take_part(int64_t n, const lmoc_flag *chosen, lmoc_impact *one) {
  one->count = 0;
  for (int64_t i = 0; i < n; i++) if (chosen[i]) one->which[one->count++] = i;
}

int lmoc_strike(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_flag *sharing, const lmoc_flag *held,
                const double *restitution, lmoc_impact *found, lmoc_flag *laws) {
  const int64_t n = k->laws.count;
  take_part(n, sharing, found);
  const int64_t m = found->count;
  double *matrix = malloc((size_t)(m*m + 3*m + 1) * sizeof(double)), *rate = matrix + m*m, *e = rate + m, *share = e + m;
  int64_t *side = malloc((size_t)(3*m + 1) * sizeof(int64_t)), *rows = side + m, *normal = rows + m, *place;
  lmoc_flag *unique = malloc((size_t)m + 1);
  lmoc_friction friction = {0, rows, normal, share};
  int law = 0, status = LMOC_NO_MEMORY;
  place = malloc((size_t)(n + 1) * sizeof(int64_t));
  if (matrix && side && unique && place) {
    lmoc_part_of(now, n, found, matrix);
    for (int64_t i = 0; i < m; i++) place[found->which[i]] = i;
    for (int64_t i = 0; i < m; i++) {
      const int64_t own = found->which[i];
      rate[i] = now->rate[own];
      if (held[own] && fabs(rate[i]) <= lmoc_least_rate(now, n, own)) rate[i] = 0; /* rounding, which would cost energy */
      side[i] = held[own] || rate[i] < 0 ? LMOC_FREE : LMOC_LOWER; /* what is closed takes part in most impacts */
      e[i] = restitution[own];
      if (!k->laws.contact[own]) continue;
      rows[friction.count] = i;
      normal[friction.count] = place[k->laws.normal[own]];
      share[friction.count++] = now->stick[own];
    }
    status = lmoc_collide(m, matrix, rate, e, &friction, side, found->impulse, found->rate, found->lost, unique, &law);
    found->law = law;
  }
  if (status == LMOC_NO_SOLUTION) {
    status = LMOC_NO_IMPULSES;
    lmoc_contradicting(m, found->impulse, found->which, n, laws);
  }
  free(matrix);
  free(side);
  free(unique);
  free(place);
  return status;
}

int lmoc_behind(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_impact *impact, lmoc_contact *to) {
  const int64_t n = k->laws.count;
  for (int64_t j = 0; j < k->states; j++) {
    double change = 0;
    for (int64_t i = 0; i < impact->count; i++) change += now->response[j*n + impact->which[i]] * impact->impulse[i];
    to->x[j] = now->x[j] + (k->ledger[j] ? 0 : change);
  }
  return lmoc_contact_at(k, now->time, to->x, to);
}

int lmoc_rest(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_flag *held, lmoc_impact *found) {
  const int64_t n = k->laws.count;
  take_part(n, held, found);
  const int64_t m = found->count;
  double *u = malloc((size_t)(2*m*m + 2*m + 1) * sizeof(double)), *v = u + m*m, *values = v + m*m, *right = values + m;
  if (!u) return LMOC_NO_MEMORY;
  lmoc_part_of(now, n, found, u);
  for (int64_t i = 0; i < m; i++) right[i] = -now->rate[found->which[i]];
  lmoc_singular_values(m, m, u, v, values);
  lmoc_least_squares(m, u, v, values, DBL_EPSILON * (double)m, right, found->impulse);
  free(u);
  return LMOC_SOLVED;
}

int lmoc_resisted(const lmoc_kinematics *k, double time, const double *x, const lmoc_flag *closed, double *behind,
                  lmoc_flag *laws) {
  const int64_t n = k->laws.count, size = lmoc_contact_size(n, k->states);
  double *memory = calloc((size_t)(2*size + n + 1), sizeof(double));
  lmoc_flag *striking = malloc((size_t)(2*n) + 1), *sharing = striking + n;
  lmoc_impact *impact = lmoc_impact_new(n);
  lmoc_contact now, next;
  int status = LMOC_NO_MEMORY, strikes = 0;
  memcpy(behind, x, (size_t)k->states * sizeof(double));
  if (memory && striking && impact) {
    lmoc_contact_place(n, k->states, memory, &now);
    lmoc_contact_place(n, k->states, memory + size, &next);
    status = lmoc_contact_at(k, time, x, &now);
    for (int64_t i = 0; i < n && !status; i++) {
      striking[i] = lmoc_is_impulsive(k, i) && closed[i];
      strikes |= striking[i] && now.rate[i] < -lmoc_least_rate(&now, n, i);
    }
    if (strikes) {
      lmoc_sharing(k, striking, sharing);
      if (!(status = lmoc_strike(k, &now, sharing, closed, memory + 2*size, impact, laws)) &&
          !(status = lmoc_behind(k, &now, impact, &next)))
        memcpy(behind, next.x, (size_t)k->states * sizeof(double));
    }
  }
  free(memory);
  free(striking);
  lmoc_impact_free(impact);
  return status;
}
