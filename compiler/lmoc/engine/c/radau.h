/* Radau IIA of order 5 for stiff equations, with dense output of order 3. */

#ifndef LMOC_RADAU_H
#define LMOC_RADAU_H

#include <stdint.h>

/* An integration under way. `rates` have no numbers where there are none; `mark` keeps what nonlinear blocks have been solved
   for, and `go_back` goes on from there. `slopes` takes the Jacobian, (n, n); without it, differences do. Where the owner
   has a way of its own to keep a large one, `factor` prepares for steps of the length h, 0 where that is impossible, and
   `substitute` solves with the real matrix, or with the complex one for a real and an imaginary part, (2, n). */
typedef struct {
  int64_t n;
  void *owner;
  void (*rates)(void *owner, double time, const double *x, double *out);
  void (*mark)(void *owner), (*go_back)(void *owner);
  void (*slopes)(void *owner, double time, const double *x, double *out);
  int (*factor)(void *owner, double h);
  void (*substitute)(void *owner, int complex, double *v);
  const double *atol;
  double rtol, end, max_step, step_size;
  double t, before, length;        /* s: now, where the last step began, and its length */
  int64_t rejected, evaluations, jacobians;
  double *x, *last, *f;            /* (n,) the state, that before the step, derivatives */
  double *dense;                   /* (3, n) of the last step; no numbers without one */
  double *jacobian, *real, *both;  /* (n, n), its factors, (2 n, 2 n); or 0 */
  double *z, *w, *k;               /* (3, n) increments of the stages, transformed ones, derivatives */
  double *first, *second, *scale, *next, *error; /* (n,), (2 n,), (n,) ... */
  int32_t *pivots;                 /* (3 n,) */
  double factored, earlier, earlier_error; /* s, the length with whose factors; of the step before, 0 for none; its error */
  int fresh, rejected_last;
} lmoc_radau;

/* Lay out its memory, or say how many doubles with no place; after `n` and the functions are known. */
int64_t lmoc_radau_place(lmoc_radau *s, double *memory);

/* From another state, `x`, at the time `t`. */
void lmoc_radau_jump(lmoc_radau *s);

int lmoc_radau_step(lmoc_radau *s);                               /* one step; 0 where none can be made */
void lmoc_radau_within(const lmoc_radau *s, double time, double *out);  /* the state within the last one */

#endif
