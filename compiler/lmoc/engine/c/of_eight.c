/* The engine for eight runs at a time, for processors with AVX-512. */

#define LMOC_OF_LANES 8

#include "lane.h"

#if LMOC_WIDER

#include "tape.c"

#include "blocks.c"
#include "copies.c"
#include "lanes.c"
#include "many.h"
#include "series.c"
#include "taylor.c"

const lmoc_many lmoc_eight = {
  LMOC_LANES, LMOC_LENGTH, lmoc_tape_run_of_eight, &lmoc_block_functions_of_eight, lmoc_series_order_of_eight,
  lmoc_series_open_of_eight, lmoc_series_solve_of_eight, lmoc_lanes_walk_of_eight,
};

#endif
