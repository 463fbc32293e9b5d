/* Reading an executable. Integers are of 7 bits a byte, the lowest first, all but the last with the highest bit set, and
   with the sign in the lowest bit; numbers are 8 bytes each, the lowest first. */

#include "bytes.h"

#include <stdlib.h>

int64_t lmoc_read_integer(lmoc_bytes *b) {
  uint64_t value = 0;
  for (int shift = 0; shift < 64; shift += 7) {
    if (b->at == b->end) break;
    const uint8_t byte = *b->at++;
    value |= (uint64_t)(byte & 127) << shift;
    if (!(byte & 128)) return (int64_t)(value >> 1) ^ -(int64_t)(value & 1);
  }
  b->failed = 1;
  return 0;
}

static void *room(lmoc_bytes *b, int64_t count, size_t size) {
  void *found = count < 0 || count > b->end - b->at ? 0 : calloc((size_t)count + 1, size);
  if (!found) b->failed = 1;
  return found;
}

int32_t *lmoc_read_integers(lmoc_bytes *b, int64_t *count) {
  *count = lmoc_read_integer(b);
  int32_t *found = room(b, *count, sizeof(int32_t));
  for (int64_t k = 0; found && k < *count; k++) found[k] = (int32_t)lmoc_read_integer(b);
  return found;
}

double *lmoc_read_reals(lmoc_bytes *b, int64_t *count) {
  *count = lmoc_read_integer(b);
  double *found = room(b, 8 * *count, 1);
  for (int64_t k = 0; found && k < *count; k++, b->at += 8) {
    uint64_t bits = 0;
    for (int j = 7; j >= 0; j--) bits = bits << 8 | b->at[j];
    memcpy(found + k, &bits, 8);
  }
  return found;
}

static void read_block(lmoc_bytes *b, lmoc_block *m) {
  int64_t *sizes[] = {&m->instances, &m->size, &m->each, &m->width, &m->a, &m->b, &m->work, &m->x, &m->patient}, count;
  for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) *sizes[k] = lmoc_read_integer(b);
  const int64_t kept = lmoc_read_integer(b), sparse = lmoc_read_integer(b);
  m->unknowns = lmoc_read_integers(b, &count);
  m->residuals = lmoc_read_integers(b, &count);
  m->fill = lmoc_read_integers(b, &count);
  m->right = lmoc_read_integers(b, &count);
  if (sparse) m->start = lmoc_read_integers(b, &count), m->rows = lmoc_read_integers(b, &count);
  if (b->failed) return;
  m->pivots = calloc((size_t)((kept ? m->instances : 1) * m->size + 1), sizeof(int32_t));
  if (sparse) m->lu = lmoc_lu_new(m->size, m->start, m->rows);
  if (!m->pivots || (sparse && !m->lu)) b->failed = 1;
}

void lmoc_read_program(lmoc_bytes *b, lmoc_program *p) {
  int64_t count;
  p->size = lmoc_read_integer(b);
  const int64_t time = lmoc_read_integer(b);
  p->places = lmoc_read_integers(b, &p->constant_count);
  p->values = lmoc_read_reals(b, &count);
  const int32_t *code = lmoc_read_integers(b, &count), *index = lmoc_read_integers(b, &count);
  p->block_count = lmoc_read_integer(b);
  lmoc_block *blocks = room(b, p->block_count, sizeof(lmoc_block));
  for (int64_t k = 0; !b->failed && k < p->block_count; k++) {
    read_block(b, blocks + k);
    p->remembers |= blocks[k].work != 0;
  }
  p->tape = (lmoc_tape){lmoc_tape_run, code, index, blocks, &lmoc_block_functions, time};
}

void lmoc_put_constants(const lmoc_program *p, double *w) {
  for (int64_t k = 0; k < p->constant_count; k++) w[p->places[k]] = p->values[k];
}

void lmoc_program_forget_pivots(const lmoc_program *p) {
  for (int64_t k = 0; k < p->block_count; k++)
    if (p->tape.blocks[k].lu) lmoc_lu_forget(p->tape.blocks[k].lu);
}

void lmoc_program_forget(const lmoc_program *p) {
  for (int64_t k = 0; k < p->block_count; k++) p->tape.blocks[k].ready = 0;
  lmoc_program_forget_pivots(p);
}
