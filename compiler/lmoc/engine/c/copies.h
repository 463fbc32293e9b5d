/* Blocks of many equal copies as part of a loop over these, several copies at a time. */

#ifndef LMOC_COPIES_H
#define LMOC_COPIES_H

#include "tape.h"

/* An instruction within `rows`: its number, its length, the block; then operands as pairs of place and flag. `low` and
   `count` say which copies. */

/* The unknowns of a linear block (the last operands) from the entries of its matrix and its residuals at zero. */
void LMOC_NAME(lmoc_copies_linear)(const lmoc_block *m, const int32_t *p, double *w, int64_t low, int64_t count);

/* Newton's method, each copy on its own: where it begins; one correction, which returns how many are not solved; the end:
   FAILED and no numbers where a copy is not solved, FAR where its solution is not near. */
void lmoc_copies_begin(const lmoc_block *m, double *w, int64_t low, int64_t count);
int64_t lmoc_copies_correct(const lmoc_block *m, const int32_t *p, double *w, int64_t low, int64_t count, int64_t iteration);
int lmoc_copies_end(const lmoc_block *m, double *w, int64_t low, int64_t count);

#endif
