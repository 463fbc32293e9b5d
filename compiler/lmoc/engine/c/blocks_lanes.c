/* Blocks of several runs at a time. */

#define LMOC_OF_LANES
#include "blocks.c"
