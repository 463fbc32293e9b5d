/* The interpreter of tapes for several runs at a time. */

#define LMOC_OF_LANES
#include "tape.c"
