/* Steps of several runs at a time along their Taylor series. */

#define LMOC_OF_LANES
#include "taylor.c"
