/* Linear complementarity problems with bounds, and those with the friction of contacts. */

#ifndef LMOC_COMPLEMENTARITY_H
#define LMOC_COMPLEMENTARITY_H

#include <stdint.h>

/* Where a component is. */
enum { LMOC_LOWER = -1, LMOC_FREE = 0, LMOC_UPPER = 1 };

/* What a problem has come to. */
enum { LMOC_SOLVED = 0, LMOC_NO_SOLUTION = 1, LMOC_NO_MEMORY = -1 };

typedef uint8_t lmoc_flag;

#define LMOC_NEGLIGIBLE 1e-11  /* violations below this share of the terms they are the sum of count as none ... */
#define LMOC_AT_LIMIT 1e-9     /* share of its limit beyond which a friction slides, and within which several give way */

/* Find x and w = M x + q with x = lower and w >= 0, or lower < x < upper and w = 0, or x = upper and w <= 0.
   `side` says where to begin and where each component is in the end; `unique` whether x is determined there. Without a
   solution x is the last iterate. */
int lmoc_complementarity(int64_t n, const double *matrix, const double *q, const double *lower, const double *upper,
                         double *x, double *w, int64_t *side, lmoc_flag *unique);

/* Which components of the last iterate x cannot be satisfied: those that have grown without bound. `which` names them. */
void lmoc_contradicting(int64_t n, const double *x, const int64_t *which, int64_t all, lmoc_flag *out);

/* By how much each component of w may be wrong: a share of its terms, and rounding of the others'. */
void lmoc_slack(int64_t n, const double *matrix, const double *q, const double *x, double *slack);

/* Friction whose limits are shares of other components: which they are, of which and what share. */
typedef struct {
  int64_t count;
  const int64_t *rows, *normal;
  const double *share;
} lmoc_friction;

/* The same with such friction, whose bounds count for nothing; other lower bounds are finite. */
int lmoc_with_cones(int64_t n, const double *matrix, const double *q, const double *lower, const double *upper,
                    const lmoc_friction *friction, double *x, double *w, int64_t *side);

/* z >= 0 with w = M z + q >= 0 and z w = 0. */
int lmoc_lemke(int64_t n, const double *matrix, const double *q, double *z);

/* Parts of a whole: `parent` (n,) begins as 0, 1, 2 ..., and names the first of each part when all are joined. */
void lmoc_join(int64_t *parent, int64_t one, int64_t other);
int64_t lmoc_first_of(int64_t *parent, int64_t one);

/* y = M x + q */
void lmoc_affine(int64_t n, const double *matrix, const double *x, const double *q, double *y);

#endif
