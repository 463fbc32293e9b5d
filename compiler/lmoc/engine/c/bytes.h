/* An executable as one block of bytes, which `lower/packed.py` writes. */

#ifndef LMOC_BYTES_H
#define LMOC_BYTES_H

#include "tape.h"

/* Where reading stands. What is read beyond the end, or finds no memory, is zero, and `failed` is set. */
typedef struct {
  const uint8_t *at, *end;
  int failed;
} lmoc_bytes;

int64_t lmoc_read_integer(lmoc_bytes *b);
int32_t *lmoc_read_integers(lmoc_bytes *b, int64_t *count);  /* count, then each; never 0 but where it fails */
double *lmoc_read_reals(lmoc_bytes *b, int64_t *count);

/* A program with what belongs to it. */
typedef struct {
  lmoc_tape tape;
  int64_t size, block_count, constant_count;
  int32_t *places;        /* of constants … */
  double *values;         /* … and their values */
  int remembers;          /* it has nonlinear blocks */
} lmoc_program;

/* Read a program, and put its constants into the registers where there are some. */
void lmoc_read_program(lmoc_bytes *b, lmoc_program *p);
void lmoc_put_constants(const lmoc_program *p, double *w);

/* Factors of matrices that depend on parameters have to be made anew, and pivots to be chosen anew; or the latter alone. */
void lmoc_program_forget(const lmoc_program *p);
void lmoc_program_forget_pivots(const lmoc_program *p);

#endif
