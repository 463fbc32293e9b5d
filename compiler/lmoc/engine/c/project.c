/* Instants, and the projection onto what closed laws keep at zero.

   The equations of a closed law hold on the level at which its force is felt; what is below stays as the integrator
   carries it. Constraints that are linear in the states stay to rounding (Runge-Kutta and multistep methods keep linear
   invariants), the others drift with the local error (Hairer & Wanner, Solving Ordinary Differential Equations II,
   VII.2). Both are moved back: by Newton's method in as few states as there are constraints, chosen by pivoting, so that a
   body at rest on the ground is at rest to the last bit. */

#include "kinematics.h"
#include "manifold.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double CLOSE = 2e-16;    /* residual, as a share of the terms that make it */
static const double ROUNDING = 1e-12; /* the same, where Newton's method does not come nearer */
static const double DRIFT = 1e3;      /* errors of a step: by what a gap may have drifted that follows from the states and
                                         from a given motion */
enum { MOST_NEWTON = 12 };

int64_t lmoc_contact_size(int64_t laws, int64_t states) { return states + laws * (8 + laws + 3*states) + 1; }

void lmoc_contact_place(int64_t laws, int64_t states, double *memory, lmoc_contact *to) {
  double **rows[] = {&to->gap, &to->rate, &to->gap_scale, &to->rate_scale, &to->bias, &to->slip, &to->stick,
                     &to->force};
  to->x = memory;
  memory += states;
  for (int i = 0; i < 8; i++, memory += laws) *rows[i] = memory;
  to->delassus = memory;
  to->response = memory + laws * laws;
  to->slope = to->response + laws * states;
  to->stored = to->slope + 2*laws * states;
}

void lmoc_contact_copy(int64_t laws, int64_t states, const lmoc_contact *from, lmoc_contact *to) {
  to->time = from->time;
  memcpy(to->x, from->x, (size_t)lmoc_contact_size(laws, states) * sizeof(double));
}

int lmoc_contact_at(const lmoc_kinematics *k, double time, const double *x, lmoc_contact *to) {
  to->time = time;
  if (to->x != x) memcpy(to->x, x, k->states * sizeof(double));
  return k->at(k->owner, time, to->x, 0, to->x + k->states) ? LMOC_HELD_UP : LMOC_SOLVED;
}

void lmoc_drift(int64_t count, int64_t states, const double *slope, const double *errors, double *out) {
  for (int64_t i = 0; i < count; i++) {
    double sum = 0;
    for (int64_t j = 0; j < states; j++) sum += fabs(slope[i*states + j]) * errors[j];
    out[i] = DRIFT * sum;
  }
}

/* The equations that are to hold: those of laws, then those that tie states to each other. */
typedef struct {
  int64_t count, own, *row;             /* `own` of laws, rows of `slope`: gaps, then rates */
  double *value, *terms, *matrix, *step;
} equations;

static int pose(const lmoc_kinematics *k, const lmoc_contact *now, const equations *e) {
  double *ties = e->value + e->own, *slopes = e->matrix + e->own * k->states;
  for (int64_t i = 0; i < e->own; i++) {
    const int64_t n = k->laws.count, row = e->row[i];
    e->value[i] = row < n ? -now->gap[row] : -now->rate[row - n];
    memcpy(e->matrix + i * k->states, now->slope + row * k->states, k->states * sizeof(double));
  }
  if (e->count > e->own && k->tie(k->owner, now->time, now->x, ties, slopes)) return LMOC_HELD_UP;
  for (int64_t i = e->own; i < e->count; i++) e->value[i] = -e->value[i];
  for (int64_t i = 0; i < e->count; i++) {
    double sum = 0;
    for (int64_t j = 0; j < k->states; j++) sum += fabs(e->matrix[i * k->states + j] * now->x[j]);
    e->terms[i] = fmax(e->terms[i], sum); /* what comes to rest is small beside what it was */
  }
  return LMOC_SOLVED;
}

/* What cancels in a slope rounds as well: whether nothing else is left. */
static int within_rounding(const lmoc_kinematics *k, const lmoc_contact *now, const equations *e, double residue) {
  double largest = 0;
  for (int64_t j = 0; j < k->states; j++) largest = fmax(largest, fabs(now->x[j]));
  for (int64_t i = 0; i < e->count; i++) {
    double whole = 0;
    for (int64_t j = 0; j < k->states; j++) whole = fmax(whole, fabs(e->matrix[i * k->states + j]));
    if (!(fabs(e->value[i]) <= ROUNDING * (whole * largest + residue))) return 0;
  }
  return 1;
}

static int newton(const lmoc_kinematics *k, const equations *e, lmoc_contact *now, lmoc_contact *spare) {
  double residue = INFINITY;
  int drifted = 1, failed;
  for (int round = 0; round < MOST_NEWTON; round++) {
    const double before = residue;
    int close = 1;
    if ((failed = pose(k, now, e))) return failed;
    residue = 0;
    for (int64_t i = 0; i < e->count; i++) {
      close &= fabs(e->value[i]) <= CLOSE * e->terms[i];
      residue = fmax(residue, fabs(e->value[i]));
    }
    if (close || (residue >= 0.5 * before && within_rounding(k, now, e, residue))) return LMOC_SOLVED;
    if ((failed = lmoc_correction(e->count, k->states, e->matrix, e->value, e->step))) return failed;
    for (int64_t j = 0; j < k->states; j++) spare->x[j] = now->x[j] + e->step[j];
    if ((failed = lmoc_contact_at(k, now->time, spare->x, spare))) return failed;
    const lmoc_contact kept = *now;
    *now = *spare;
    *spare = kept;
  }
  lmoc_drift(e->count, k->states, e->matrix, k->errors, e->terms);
  for (int64_t i = 0; i < e->count; i++) drifted &= fabs(e->value[i]) <= e->terms[i];
  return drifted ? LMOC_SOLVED : LMOC_NO_STATES;
}

int lmoc_project(const lmoc_kinematics *k, const lmoc_flag *gaps, const lmoc_flag *rates, lmoc_contact *now,
                 lmoc_contact *spare, lmoc_flag *laws) {
  const int64_t n = k->laws.count;
  int64_t own = 0;
  for (int64_t i = 0; i < n; i++) own += gaps[i] + rates[i];
  if (!own) return LMOC_SOLVED;
  const int64_t count = own + k->ties;
  double *memory = calloc((size_t)(count * (k->states + 2) + k->states), sizeof(double));
  int64_t *row = malloc((size_t)count * sizeof(int64_t));
  int found = LMOC_NO_MEMORY;
  if (memory && row) {
    const equations e = {count, own, row, memory, memory + count, memory + 2*count, memory + count * (k->states + 2)};
    int64_t at = 0;
    for (int64_t i = 0; i < 2*n; i++) if ((i < n ? gaps : rates)[i % n]) row[at++] = i;
    found = newton(k, &e, now, spare);
  }
  for (int64_t i = 0; i < n; i++) laws[i] = gaps[i] || rates[i];
  free(memory);
  free(row);
  return found;
}
