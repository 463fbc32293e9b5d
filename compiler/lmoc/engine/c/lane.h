/* One run, or several at a time: `of_four.c` and `of_eight.c` compile the same sources once more for so many. Every number
   is then a row of them, one for each lane, and each lane has the bits that it has alone. */

#ifndef LMOC_LANE_H
#define LMOC_LANE_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define LMOC_WIDER 1 /* compilers that make code for several processors, of which the best is taken at run time */
#else
#define LMOC_WIDER 0
#endif

#if LMOC_OF_LANES == 8 && LMOC_WIDER
#define LMOC_LANES 8
#define LMOC_NAME(name) name##_of_eight
#define LMOC_WIDEST
#pragma GCC target("avx512f")
#pragma GCC optimize("no-tree-slp-vectorize") /* gcc 12 fuses pairs of sums and differences, whatever it is told */
#elif LMOC_OF_LANES
#ifdef __GNUC__
#define LMOC_LANES 4
#else
#define LMOC_LANES 1
#endif
#define LMOC_NAME(name) name##_of_four
#else
#define LMOC_LANES 1
#define LMOC_NAME(name) name
#endif

#if !defined(LMOC_WIDEST) && LMOC_WIDER
#define LMOC_WIDEST __attribute__((target_clones("avx2", "default"))) /* the same bits, four at a time */
#elif !defined(LMOC_WIDEST)
#define LMOC_WIDEST
#endif

#if LMOC_OF_LANES
typedef const double *lmoc_times; /* one for each lane */
#define LMOC_TIME(time, lane) ((time)[lane])
#else
typedef double lmoc_times;
#define LMOC_TIME(time, lane) (time)
#endif

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wpsabi" /* no function that is called takes or returns rows */
#define LMOC_INLINE static inline __attribute__((always_inline))
#else
#define LMOC_INLINE static inline
#endif

#if LMOC_LANES > 1
typedef double lmoc_real __attribute__((vector_size(8*LMOC_LANES), aligned(8), may_alias));
#else
typedef double lmoc_real;
#endif

#ifdef __GNUC__
#define LMOC_TOGETHER 4 /* numbers of one run that are worked on at once */
typedef double lmoc_together __attribute__((vector_size(8*LMOC_TOGETHER), aligned(8), may_alias));
#else
#define LMOC_TOGETHER 1
typedef double lmoc_together;
#endif

#define LMOC_AT(place) ((int64_t)(place)*LMOC_LANES)
#define LMOC_ROW(w, place) (*(lmoc_real *)((w) + LMOC_AT(place)))
#define LMOC_EACH_LANE for (int64_t l = 0; l < LMOC_LANES; l++)

#endif
