/* Passing a bifurcation on the branch on which the velocities are continuous.

   Where the constraints depend on each other several branches of a motion meet, and momentum continues the one that has
   come there: a smooth curve of which one point alone cannot be evaluated. The way over it is one step of Gauss
   collocation (Hairer, Nørsett & Wanner I, II.7) whose stages keep off that point, with an even number of them about it.
   Newton's method begins at each stage where the motion so far points to, as in the continuation of curves through
   branching points (Allgower & Georg, Numerical Continuation Methods, 1990, chapter 8). The step counts only if two orders
   agree within the tolerances, and if the positions found lie on one smooth curve. */

#include "passage.h"

#include <math.h>
#include <string.h>

enum { STAGES = LMOC_PASSAGE_PLACES - 2, FEWER = 6, ITERATIONS = 40 }; /* even numbers of stages, so that none is in the middle */
static const double CONVERGED = 0.01;              /* of the tolerances */
static const double NEAR = 0.25;                   /* of the way of a block's unknowns: as far from where they were expected
                                                      they may be found */
static const double SMOOTH = 1e-6;                 /* of the way: as much as they may miss the polynomial through the others */
static const double BETWEEN[] = {0.46, 0.54};      /* of the step: between the stages in the middle */
static const double SIDE = 1e-2;                   /* of the step: as far aside a derivative is taken by differences, and … */
static const double ASIDE = 1e-2;                  /* … values beside the singular place */
static const double LOOSE = 1e-9;                  /* of the size of the unknowns: rounding where constraints almost depend on
                                                      each other */

int64_t lmoc_passage_lay_out(lmoc_passage *p, double *at) {
  const int64_t n = p->n, m = p->m;
  int64_t total = 0;
#define TAKE(name, count) (p->name = at ? at + total : 0, total += (count))
  TAKE(times, LMOC_PASSAGE_PLACES), TAKE(states, LMOC_PASSAGE_PLACES*n), TAKE(solutions, LMOC_PASSAGE_PLACES*m);
  TAKE(slopes, STAGES*n), TAKE(slope, 3*n), TAKE(rates, m), TAKE(curvature, m), TAKE(end, n), TAKE(x, n), TAKE(sought, m);
  TAKE(found, 2*m);
#undef TAKE
  return total;
}

void lmoc_lagrange(int64_t count, const double *places, double time, double *weights) {
  for (int64_t j = 0; j < count; j++) {
    weights[j] = 1;
    for (int64_t k = 0; k < count; k++) if (k != j) weights[j] *= (time - places[k]) / (places[j] - places[k]);
  }
}

static void by_polynomial(lmoc_passage *p, int64_t count, double time, double *x, double *solutions) {
  double weights[LMOC_PASSAGE_PLACES];
  lmoc_lagrange(count, p->times, time, weights);
  for (int64_t i = 0; i < p->n && x; i++) {
    x[i] = 0;
    for (int64_t k = 0; k < count; k++) x[i] += weights[k]*p->states[k*p->n + i];
  }
  for (int64_t i = 0; i < p->m; i++) {
    solutions[i] = 0;
    for (int64_t k = 0; k < count; k++) solutions[i] += weights[k]*p->solutions[k*p->m + i];
  }
}

void lmoc_passage_at(lmoc_passage *p, double time, double *x, double *solutions) {
  by_polynomial(p, LMOC_PASSAGE_PLACES, time, x, solutions);
}

static int are_finite(int64_t count, const double *values) {
  double check = 0;
  for (int64_t i = 0; i < count; i++) check += 0*values[i];
  return check == 0;
}

/* The largest |a - b|, or of a alone; no number where one is none. */
static double largest(int64_t count, const double *a, const double *b) {
  double most = 0;
  for (int64_t i = 0; i < count && most == most; i++) {
    const double d = fabs(a[i] - (b ? b[i] : 0));
    if (!(d <= most)) most = d;
  }
  return most;
}

static void at(lmoc_passage *p, double time, const double *x, const double *solutions, double *slope, double *found) {
  if (!p->halted && p->near(p->owner, time, x, solutions, slope, found)) p->halted = 1;
}

/* The same; 0 where the solutions found are not near. */
static int evaluate(lmoc_passage *p, double time, const double *x, double *solutions, double *slope) {
  const double way = largest(p->m, solutions, p->solutions), size = largest(p->m, solutions, 0);
  at(p, time, x, solutions, slope, p->found);
  const int good = !p->halted && are_finite(p->n, slope) && largest(p->m, p->found, solutions) <= NEAR*way + LOOSE*(1 + size);
  memcpy(solutions, p->found, p->m * sizeof(double));
  return good;
}

/* The place a little to one side of the first. */
static void beside(lmoc_passage *p, double step, const double *slope, double *slope_there, double *found) {
  for (int64_t i = 0; i < p->n; i++) p->x[i] = p->states[i] + step*slope[i];
  at(p, p->times[0] + step, p->x, p->solutions, slope_there, found);
}

/* Where the motion leads to from the first place: derivatives of the states, the first two of the solutions. */
static int look_ahead(lmoc_passage *p, double width) {
  const int64_t n = p->n, m = p->m;
  const double step = SIDE*width;
  double *before = p->slope + n, *after = before + n, *found = p->found, *other = found + m;
  at(p, p->times[0], p->states, p->solutions, p->slope, found);
  beside(p, -step, p->slope, before, found);
  beside(p, step, p->slope, after, found);
  for (int64_t i = 0; i < n; i++) {
    const double bend = (after[i] - before[i]) / (2*step);
    before[i] = p->slope[i] - step/2*bend;
    after[i] = p->slope[i] + step/2*bend;
  }
  beside(p, -step, before, p->end, found);
  beside(p, step, after, p->end, other);
  for (int64_t i = 0; i < m; i++) {
    p->rates[i] = (other[i] - found[i]) / (2*step);
    p->curvature[i] = (other[i] - 2*p->solutions[i] + found[i]) / (step*step);
  }
  return !p->halted && are_finite(n, p->slope) && are_finite(m, p->rates) && are_finite(m, p->curvature);
}

/* One step of Gauss collocation, by fixed-point iteration; 0 where that does not converge. */
static int collocate(lmoc_passage *p, double width, int64_t stages, const double *gauss, const double *tolerance) {
  const int64_t n = p->n, m = p->m;
  const double *nodes = gauss, *matrix = gauss + stages, *weights = matrix + stages*stages;
  double missed = INFINITY, last, *end = p->states + (stages + 1)*n;
  for (int64_t k = 0; k < stages; k++) {
    const double time = width*nodes[k];
    double *x = p->states + (k + 1)*n, *solutions = p->solutions + (k + 1)*m;
    p->times[k + 1] = p->times[0] + time;
    for (int64_t i = 0; i < n; i++) x[i] = p->states[i] + time*p->slope[i];
    for (int64_t i = 0; i < m; i++) solutions[i] = p->solutions[i] + time*(p->rates[i] + time/2*p->curvature[i]);
  }
  for (int round = 0;; round++) {
    if (round == ITERATIONS) return 0;
    for (int64_t k = 0; k < stages; k++)
      if (!evaluate(p, p->times[k + 1], p->states + (k + 1)*n, p->solutions + (k + 1)*m, p->slopes + k*n)) return 0;
    last = missed;
    missed = 0;
    for (int64_t k = 0; k < stages; k++)
      for (int64_t i = 0; i < n; i++) {
        double rise = 0;
        for (int64_t j = 0; j < stages; j++) rise += matrix[k*stages + j]*p->slopes[j*n + i];
        const double x = p->states[i] + width*rise, d = fabs(x - p->states[(k + 1)*n + i]) / tolerance[i];
        if (missed == missed && !(d <= missed)) missed = d;
        p->states[(k + 1)*n + i] = x;
      }
    if (missed <= CONVERGED || (0.5*last < missed && missed <= 1)) break; /* rounding is larger the nearer the stages are */
  }
  p->times[stages + 1] = p->times[0] + width;
  for (int64_t i = 0; i < n; i++) {
    end[i] = 0;
    for (int64_t j = 0; j < stages; j++) end[i] += weights[j]*p->slopes[j*n + i];
    end[i] = p->states[i] + width*end[i];
  }
  by_polynomial(p, stages + 1, p->times[stages + 1], 0, p->solutions + (stages + 1)*m);
  return evaluate(p, p->times[stages + 1], end, p->solutions + (stages + 1)*m, p->slopes);
}

/* Whether the blocks' unknowns lie on one smooth curve, about the middle of the step, too. There a step onto another branch
   has a kink, and one from a curve to another that comes near without meeting it differs from the polynomial through its
   places. */
static int is_smooth(lmoc_passage *p, double width) {
  const double way = largest(p->m, p->solutions + (LMOC_PASSAGE_PLACES - 1)*p->m, p->solutions);
  for (int k = 0; k < 2; k++) {
    const double time = p->times[0] + width*BETWEEN[k];
    lmoc_passage_at(p, time, p->x, p->sought);
    at(p, time, p->x, p->sought, p->slopes, p->found);
    if (p->halted || !are_finite(p->n, p->slopes)) return 0;
    for (int64_t i = 0; i < p->m; i++)
      if (!(fabs(p->found[i] - p->sought[i]) <= SMOOTH*way + LOOSE*(1 + fabs(p->solutions[i])))) return 0;
  }
  return 1;
}

int lmoc_passage_find(lmoc_passage *p, double width, const double *tolerance) {
  const double *all = p->gauss + 2*FEWER + FEWER*FEWER;
  p->halted = 0;
  if (!look_ahead(p, width) || !collocate(p, width, FEWER, p->gauss, tolerance)) return 0;
  memcpy(p->end, p->states + (FEWER + 1)*p->n, p->n * sizeof(double));
  if (!collocate(p, width, STAGES, all, tolerance)) return 0;
  for (int64_t i = 0; i < p->n; i++)
    if (!(fabs(p->states[(STAGES + 1)*p->n + i] - p->end[i]) <= tolerance[i])) return 0;
  return is_smooth(p, width);
}

int lmoc_passage_beside(double time, double singular, double width, double *times, double *weights) {
  static const double places[] = {-2, -1, 1, 2}, shares[] = {-1, 4, 4, -1};
  times[0] = time;
  weights[0] = 1;
  if (!(fabs(time - singular) < ASIDE*width/4)) return 1;
  for (int k = 0; k < LMOC_BESIDE; k++) {
    times[k] = time + ASIDE*width*places[k];
    weights[k] = shares[k]/6;
  }
  return LMOC_BESIDE;
}
