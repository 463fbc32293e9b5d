/* The order of pivots of a sparse matrix and the pattern of its factors, chosen once for values that change little.

   Markowitz' criterion with threshold pivoting (Duff, Erisman, Reid, Direct Methods for Sparse Matrices, 2nd ed., 2017,
   chapters 7 and 10): the column with the fewest entries, and in it the shortest row whose number is large enough.
   Entries that are zero count for the pattern, because the next values may not be. Ties are decided by indices alone,
   so that the order is the same on every machine. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lu.h"

#define THRESHOLD 0.1 /* of the largest number in its column: as small as a pivot may be for the sake of sparsity */

/* A list of indices that grows, with a number for each where it is a row. A long one has a table of places, so that a
   row or column with an entry everywhere (an arrowhead) costs no more than others. */
typedef struct { int32_t count, room, *index, *table, mask; double *value; } list;

#define MANY 16 /* operations for each entry of the factors, from which they are not listed */
#define LONG 32 /* entries from which there is a table */

typedef struct { int32_t length, column; } entry; /* of the heap: a column and its length when it was put there */

typedef struct {
  int32_t n;
  list *row, *column;       /* what is left of the matrix */
  list *below, *right;      /* of each pivot: the rows below it, and the columns to the right in its row */
  char *done;
  entry *heap;
  int64_t heaped, heap_room;
  int no_memory;
} elimination;

static uint32_t home(const list *l, int32_t index) { return ((uint32_t)index * 2654435761u) & (uint32_t)l->mask; }

/* Where an index stands in the table, or the free place where it would. */
static uint32_t probe(const list *l, int32_t index) {
  uint32_t at = home(l, index);
  while (l->table[at] && l->index[l->table[at] - 1] != index) at = (at + 1) & (uint32_t)l->mask;
  return at;
}

static int tabulate(list *l, int32_t room) {
  int32_t *table = calloc(2*(size_t)room, sizeof *table);
  if (!table) return 0;
  free(l->table);
  l->table = table;
  l->mask = 2*room - 1;
  for (int32_t k = 0; k < l->count; k++) table[probe(l, l->index[k])] = k + 1;
  return 1;
}

static int grow(list *l, int with_values) {
  if (l->count < l->room) return 1;
  const int32_t room = l->room ? 2*l->room : 4;
  int32_t *index = realloc(l->index, room * sizeof *index);
  if (!index) return 0;
  l->index = index;
  if (with_values) {
    double *value = realloc(l->value, room * sizeof *value);
    if (!value) return 0;
    l->value = value;
  }
  l->room = room;
  return room <= LONG || tabulate(l, room);
}

static void append(elimination *e, list *l, int32_t index, const double *value) {
  if (!grow(l, value != 0)) { e->no_memory = 1; return; }
  if (l->table) l->table[probe(l, index)] = l->count + 1;
  if (value) l->value[l->count] = *value;
  l->index[l->count++] = index;
}

/* The place of an index in a list, or -1. */
static int32_t find(const list *l, int32_t index) {
  if (l->table) return l->table[probe(l, index)] - 1;
  for (int32_t k = 0; k < l->count; k++)
    if (l->index[k] == index) return k;
  return -1;
}

/* Take an index out of the table: those behind it move up (Knuth, The Art of Computer Programming 3, algorithm 6.4R). */
static void take_out(list *l, int32_t index) {
  uint32_t hole = probe(l, index), at = hole;
  for (;;) {
    at = (at + 1) & (uint32_t)l->mask;
    if (!l->table[at]) break;
    const uint32_t wanted = home(l, l->index[l->table[at] - 1]);
    if (((at - wanted) & (uint32_t)l->mask) >= ((at - hole) & (uint32_t)l->mask)) {
      l->table[hole] = l->table[at];
      hole = at;
    }
  }
  l->table[hole] = 0;
}

static void take_away(list *l, int32_t k) {
  const int32_t last = l->count - 1;
  if (l->table) {
    take_out(l, l->index[k]);
    if (k != last) l->table[probe(l, l->index[last])] = k + 1;
  }
  l->index[k] = l->index[last];
  if (l->value) l->value[k] = l->value[last];
  l->count = last;
}

static int before(entry a, entry b) { return a.length != b.length ? a.length < b.length : a.column < b.column; }

static void push(elimination *e, int32_t column) {
  if (e->heaped == e->heap_room) {
    const int64_t room = 2*e->heap_room + 16;
    entry *heap = realloc(e->heap, room * sizeof *heap);
    if (!heap) { e->no_memory = 1; return; }
    e->heap = heap;
    e->heap_room = room;
  }
  const entry own = {e->column[column].count, column};
  int64_t k = e->heaped++;
  for (; k > 0 && before(own, e->heap[(k - 1)/2]); k = (k - 1)/2) e->heap[k] = e->heap[(k - 1)/2];
  e->heap[k] = own;
}

static entry pop(elimination *e) {
  const entry first = e->heap[0], last = e->heap[--e->heaped];
  int64_t k = 0;
  for (int64_t child; (child = 2*k + 1) < e->heaped; k = child) {
    if (child + 1 < e->heaped && before(e->heap[child + 1], e->heap[child])) child++;
    if (!before(e->heap[child], last)) break;
    e->heap[k] = e->heap[child];
  }
  e->heap[k] = last;
  return first;
}

/* Of the rows whose number in column j is large enough the shortest; -1 where all are zero or no numbers. */
static int32_t pivot_row(const elimination *e, int32_t j) {
  const list *column = &e->column[j];
  double largest = 0;
  for (int32_t k = 0; k < column->count; k++) {
    const list *row = &e->row[column->index[k]];
    largest = fmax(largest, fabs(row->value[find(row, j)]));
  }
  if (!(largest > 0) || largest * 0 != 0) return -1;
  int32_t best = -1, length = 0;
  double size = 0;
  for (int32_t k = 0; k < column->count; k++) {
    const int32_t i = column->index[k];
    const list *row = &e->row[i];
    const double own = fabs(row->value[find(row, j)]);
    if (!(own >= THRESHOLD * largest)) continue;
    const int better = row->count != length ? row->count < length : own != size ? own > size : i < best;
    if (best < 0 || better) { best = i; length = row->count; size = own; }
  }
  return best;
}

/* Subtract a multiple of the pivot's row from another one. */
static void subtract(elimination *e, const list *own, int32_t j, double pivot, int32_t b) {
  list *target = &e->row[b];
  const int32_t at = find(target, j);
  const double factor = target->value[at] / pivot;
  take_away(target, at);
  for (int32_t k = 0; k < own->count; k++) {
    const int32_t c = own->index[k], at_c = find(target, c);
    const double less = factor * own->value[k], value = -less;
    if (at_c >= 0) target->value[at_c] -= less;
    else {
      append(e, target, c, &value);
      append(e, &e->column[c], b, 0);
    }
  }
}

static int ascending(const void *a, const void *b) {
  const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
  return (x > y) - (x < y);
}

static void eliminate_one(elimination *e, int32_t i, int32_t j, int32_t pivot) {
  list *own = &e->row[i];
  const int32_t at = find(own, j);
  const double value = own->value[at];
  take_away(own, at);
  list *column = &e->column[j];
  take_away(column, find(column, i));
  for (int32_t k = 0; k < own->count; k++) {
    list *other = &e->column[own->index[k]];
    take_away(other, find(other, i));
  }
  e->below[pivot] = *column; /* the list has a new owner */
  memset(column, 0, sizeof *column);
  if (e->below[pivot].count) qsort(e->below[pivot].index, e->below[pivot].count, sizeof(int32_t), ascending);
  for (int32_t k = 0; k < e->below[pivot].count && !e->no_memory; k++) subtract(e, own, j, value, e->below[pivot].index[k]);
  for (int32_t k = 0; k < own->count; k++) {
    append(e, &e->right[pivot], own->index[k], 0);
    push(e, own->index[k]);
  }
}

static int eliminate(elimination *e, int32_t *row, int32_t *column) {
  for (int32_t j = 0; j < e->n; j++) push(e, j);
  int32_t pivot = 0;
  while (e->heaped && !e->no_memory) {
    const entry next = pop(e);
    const int32_t j = next.column;
    if (e->done[j] || next.length != e->column[j].count) continue; /* it has been put there anew */
    const int32_t i = pivot_row(e, j);
    if (i < 0) return LMOC_LU_SINGULAR;
    e->done[j] = 1;
    row[pivot] = i;
    column[pivot] = j;
    eliminate_one(e, i, j, pivot++);
  }
  return e->no_memory ? LMOC_LU_NO_MEMORY : LMOC_LU_GOOD;
}

static elimination *begin(const lmoc_lu *f, const double *values) {
  elimination *e = calloc(1, sizeof *e);
  if (!e) return 0;
  const int64_t n = e->n = (int32_t)f->n;
  e->row = calloc(n + 1, sizeof(list));
  e->column = calloc(n + 1, sizeof(list));
  e->below = calloc(n + 1, sizeof(list));
  e->right = calloc(n + 1, sizeof(list));
  e->done = calloc(n + 1, 1);
  e->no_memory = !e->row || !e->column || !e->below || !e->right || !e->done;
  for (int32_t j = 0; j < n && !e->no_memory; j++)
    for (int32_t k = f->start[j]; k < f->start[j + 1]; k++) {
      append(e, &e->row[f->rows[k]], j, &values[k]);
      append(e, &e->column[j], f->rows[k], 0);
    }
  return e;
}

static void end(elimination *e) {
  list *lists[] = {e->row, e->column, e->below, e->right};
  for (int which = 0; which < 4; which++) {
    for (int64_t k = 0; lists[which] && k < e->n; k++) {
      free(lists[which][k].index);
      free(lists[which][k].value);
      free(lists[which][k].table);
    }
    free(lists[which]);
  }
  free(e->done);
  free(e->heap);
  free(e);
}

static void *more(void *old, int64_t count, size_t each, int *good) {
  void *found = realloc(old, (count + 1) * each);
  if (!found) *good = 0;
  return found ? found : old;
}

/* List the operations of a factorization in their order, unless they are many beside the entries of the factors: long
   columns cost less as they are than by a list, which would have to be read from memory. */
static int list_operations(lmoc_lu *f) {
  const int64_t n = f->n, upper = f->u_start[n], lower = f->l_start[n], entries = f->a_start[n];
  int64_t count = 0;
  for (int64_t e = 0; e < upper; e++) count += f->l_start[f->u_place[e] + 1] - f->l_start[f->u_place[e]];
  free(f->slot);
  f->slot = 0;
  if (count > MANY * (upper + lower + n)) return LMOC_LU_GOOD;
  int32_t *place = calloc(n + 1, sizeof(int32_t)); /* of the rows of one column in the array of factors */
  f->slot = malloc((size_t)(entries + n + 3*count + 1) * sizeof(int32_t));
  if (!place || !f->slot) {
    free(place);
    return LMOC_LU_NO_MEMORY;
  }
  f->end = f->slot + entries;
  f->operations = f->end + n;
  int32_t *o = f->operations;
  for (int32_t k = 0; k < n; k++) {
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++) place[f->u_place[e]] = e;
    for (int32_t g = f->l_start[k]; g < f->l_start[k + 1]; g++) place[f->l_place[g]] = (int32_t)upper + g;
    place[k] = (int32_t)(upper + lower) + k;
    for (int32_t e = f->a_start[k]; e < f->a_start[k + 1]; e++) f->slot[e] = place[f->a_place[e]];
    for (int32_t e = f->u_start[k]; e < f->u_start[k + 1]; e++)
      for (int32_t g = f->l_start[f->u_place[e]]; g < f->l_start[f->u_place[e] + 1]; g++) {
        *o++ = place[f->l_place[g]];
        *o++ = (int32_t)upper + g;
        *o++ = e;
      }
    f->end[k] = (int32_t)(o - f->operations);
  }
  free(place);
  return LMOC_LU_GOOD;
}

/* The tables of `lmoc_lu` from the pivots. */
static int lay_out(lmoc_lu *f, const elimination *e) {
  const int64_t n = f->n;
  int64_t upper = 0, lower = 0;
  for (int64_t k = 0; k < n; k++) { upper += e->right[k].count; lower += e->below[k].count; }
  int good = 1;
  f->u_place = more(f->u_place, upper, sizeof(int32_t), &good);
  f->l_place = more(f->l_place, lower, sizeof(int32_t), &good);
  f->l_column = more(f->l_column, lower, sizeof(int32_t), &good);
  f->u = more(f->u, upper + lower + n, sizeof(double), &good);
  f->l = f->u ? f->u + upper : 0;
  f->d = f->l ? f->l + lower : 0;
  int32_t *row_place = malloc((2*n + 1) * sizeof(int32_t)), *column_place = row_place ? row_place + n : 0;
  if (!good || !row_place) { free(row_place); return LMOC_LU_NO_MEMORY; }
  for (int32_t k = 0; k < n; k++) { row_place[f->row[k]] = k; column_place[f->column[k]] = k; }
  memset(f->u_start, 0, (n + 1) * sizeof(int32_t));
  for (int64_t k = 0, a = 0, l = 0; k < n; k++) {
    f->a_start[k] = (int32_t)a;
    f->l_start[k] = (int32_t)l;
    for (int32_t s = f->start[f->column[k]]; s < f->start[f->column[k] + 1]; s++, a++) {
      f->a_place[a] = row_place[f->rows[s]];
      f->a_source[a] = s;
    }
    for (int32_t b = 0; b < e->below[k].count; b++) {
      f->l_column[l] = (int32_t)k;
      f->l_place[l++] = row_place[e->below[k].index[b]];
    }
    for (int32_t c = 0; c < e->right[k].count; c++) f->u_start[column_place[e->right[k].index[c]] + 1]++;
    f->a_start[k + 1] = (int32_t)a;
    f->l_start[k + 1] = (int32_t)l;
  }
  for (int64_t k = 0; k < n; k++) f->u_start[k + 1] += f->u_start[k];
  for (int32_t k = 0; k < n; k++) /* a column of U in the order in which its entries are eliminated */
    for (int32_t c = 0; c < e->right[k].count; c++) f->u_place[f->u_start[column_place[e->right[k].index[c]]]++] = k;
  for (int64_t k = n; k > 0; k--) f->u_start[k] = f->u_start[k - 1];
  if (n) f->u_start[0] = 0;
  free(row_place);
  memset(f->x, 0, 2*n * sizeof(double));
  return list_operations(f);
}

int lmoc_lu_choose(lmoc_lu *f, const double *values) {
  elimination *e = begin(f, values);
  int found = e && !e->no_memory ? eliminate(e, f->row, f->column) : LMOC_LU_NO_MEMORY;
  if (found == LMOC_LU_GOOD) found = lay_out(f, e);
  if (e) end(e);
  f->ready = found == LMOC_LU_GOOD;
  if (f->ready && values != f->chosen) memcpy(f->chosen, values, (size_t)f->start[f->n] * sizeof(double));
  return found;
}
