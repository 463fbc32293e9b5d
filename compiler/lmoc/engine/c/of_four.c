/* The engine for four runs at a time, and the choice between four and eight. */

#define LMOC_OF_LANES 4

#include "tape.c"

#include "blocks.c"
#include "copies.c"
#include "lanes.c"
#include "many.h"
#include "series.c"
#include "taylor.c"

const lmoc_many lmoc_four = {
  LMOC_LANES, LMOC_LENGTH, lmoc_tape_run_of_four, &lmoc_block_functions_of_four, lmoc_series_order_of_four,
  lmoc_series_open_of_four, lmoc_series_solve_of_four, lmoc_lanes_walk_of_four,
};

const lmoc_many *lmoc_at_once(void) {
#if LMOC_WIDER
  if (__builtin_cpu_supports("avx512f")) return &lmoc_eight;
#endif
  return &lmoc_four;
}
