/* Runs that go on several at a time. */

#define LMOC_OF_LANES
#include "lanes.c"

/* How many. */
int64_t lmoc_lane_count(void) { return LMOC_LANES; }
int64_t lmoc_lane_length(void) { return LMOC_LENGTH; }
