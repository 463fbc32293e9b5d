/* Closures of loops that are solved for their coordinates, and have several solutions: whether a step of a co-simulation has
   stayed on the branch on which it began. */

#include "fmu.h"

static const double VANISHES = 1e-5; /* of the largest determinant of a loop that there was: beyond it coordinates tell less
                                        of where it goes than tolerances ask for, and it may stand there for ever */
enum { OF_LOOP = 4 };                /* unknowns of which determinants are compared so; of more they vary more */
static const double TURNED = 2;      /* rad that an angle may turn in a step by its velocity at an end of it … */
static const double UNEXPLAINED = 1; /* … and be elsewhere than velocities tell: both together are less than a whole turn */
static const double NEXT_TO = 1e-3;  /* of a step, for a difference quotient */

/* Where one of their determinants changes its sign or vanishes, the motion has come to a place where these coordinates do not
   tell where the mechanism goes. */
int fmu_branches_stand(fmu *f) {
  int64_t at = 0;
  if (!f->model->branches) return 1;
  for (int64_t i = 0; i < f->model->right.block_count; i++) {
    const lmoc_block *b = f->blocks[RIGHT] + i;
    const double least = pow(VANISHES, fmax(1, (double)b->size / OF_LOOP));
    for (int64_t j = 0; b->work && j < b->instances; j++, at++) {
      const double det = f->w[RIGHT][b->work + j];
      if (!f->now.judged) f->sign[at] = det;
      else if (!(det * copysign(1, f->sign[at]) > least * fabs(f->sign[at]))) return 0;
      else if (fabs(det) > fabs(f->sign[at])) f->sign[at] = det;
    }
  }
  f->now.judged = 1;
  return 1;
}

/* The unknowns at a short way from a place: 0 where there are none. */
static int next_to(fmu *f, double way, double time, const double *x, const double *slope, double *unknowns) {
  for (int64_t i = 0; i < f->model->states; i++) f->moved[i] = x[i] + way*slope[i];
  if (lmoc_evaluate(&f->call, time + way, f->moved)) return 0;
  memcpy(unknowns, f->call.solution, (size_t)f->call.remembered * sizeof(double));
  return 1;
}

int fmu_branches_follow(fmu *f, const lmoc_steps *s) {
  lmoc_call *c = &f->call;
  const int64_t n = f->model->states, count = c->remembered;
  const size_t size = (size_t)count * sizeof(double);
  const double h = s->length, little = NEXT_TO * h, *begin = c->solution + 2*count;
  double *end = f->branch, *before = end + count, *after = before + count;
  if (!f->model->branches || !count || !c->marked) return 1;
  if (lmoc_evaluate(c, s->goal, s->x_new)) return 0;
  memcpy(end, c->solution, size);
  const int known = next_to(f, -little, s->goal, s->x_new, s->k + 12*n, before)
                    && next_to(f, little, s->t, s->x, s->k, after);
  memcpy(c->solution, end, size); /* the registers again as they are there, on the branch that is judged */
  memcpy(c->x, s->x_new, (size_t)n * sizeof(double));
  c->time = s->goal;
  *c->last = 0;
  if (!known || lmoc_evaluate(c, s->goal, s->x_new)) return 0;
  for (int64_t k = 0; k < count; k++) {
    const double first = (after[k] - begin[k]) / NEXT_TO, last = (end[k] - before[k]) / NEXT_TO;
    if (!f->model->turning[k]) continue;
    if (!(fmax(fabs(first), fabs(last)) <= TURNED && fabs(end[k] - begin[k] - (first + last)/2) <= UNEXPLAINED)) return 0;
  }
  return 1;
}
