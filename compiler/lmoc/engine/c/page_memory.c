/* Memory in WebAssembly: whenever that grows, what the host sees of it moves away. So it grows by much, when a scene is
   made, and what is freed serves again for what is as large to a power of two. */

#include "page.h"

#if defined(__wasm__)

#include <stddef.h>

enum { CLASSES = 28, LEAST = 16, PIECE = 1 << 16 };

typedef union head {
  struct { union head *next; size_t class; } free;
  char aligned[LEAST];
} head;

extern unsigned char __heap_base;
static head *unused[CLASSES];
static unsigned char *top, *end;

static int grow(size_t size) {
  const size_t pieces = (size + PIECE - 1) / PIECE;
  if (!top) top = &__heap_base + (-(size_t)&__heap_base & (LEAST - 1));
  if (__builtin_wasm_memory_grow(0, pieces) == (size_t)-1) return 0;
  end = (unsigned char *)(__builtin_wasm_memory_size(0) * PIECE);
  return 1;
}

int lmoc_page_reserve(int size) { return (size_t)(end - top) >= (size_t)size || grow((size_t)size); }

void *malloc(size_t size) {
  size_t class = 0;
  while (class < CLASSES && ((size_t)LEAST << class) < size) class++;
  if (class == CLASSES) return 0;
  head *found = unused[class];
  if (found) unused[class] = found->free.next;
  else {
    const size_t whole = sizeof(head) + ((size_t)LEAST << class);
    if ((size_t)(end - top) < whole && !grow(whole)) return 0;
    found = (head *)top;
    found->free.class = class;
    top += whole;
  }
  return found + 1;
}

void free(void *place) {
  if (!place) return;
  head *own = (head *)place - 1;
  own->free.next = unused[own->free.class];
  unused[own->free.class] = own;
}

void *calloc(size_t count, size_t size) {
  if (size && count > SIZE_MAX / size) return 0;
  void *found = malloc(count * size);
  return found ? memset(found, 0, count * size) : 0;
}

void *realloc(void *place, size_t size) {
  const size_t room = place ? (size_t)LEAST << ((head *)place - 1)->free.class : 0;
  if (size <= room) return place;
  void *found = malloc(size);
  if (!found) return 0;
  if (place) memcpy(found, place, room);
  free(place);
  return found;
}

#else

int lmoc_page_reserve(int size) { return size >= 0; }

#endif
