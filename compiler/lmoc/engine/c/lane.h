/* One run, or several at a time: `…_lanes.c` compile the same sources once more, for LMOC_LANES of them. Every number is
   then a row of so many, one for each lane, and each lane has the bits that it has alone. */

#ifndef LMOC_LANE_H
#define LMOC_LANE_H

#include <stdint.h>

#if defined(LMOC_OF_LANES) && defined(__GNUC__)
#define LMOC_LANES 4
#else
#define LMOC_LANES 1
#endif

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wpsabi" /* no function that is called takes or returns rows */
#endif

#if LMOC_LANES > 1
typedef double lmoc_real __attribute__((vector_size(8*LMOC_LANES), aligned(8), may_alias));
#else
typedef double lmoc_real;
#endif

#ifdef LMOC_OF_LANES
#define LMOC_NAME(name) name##_lanes
typedef const double *lmoc_times; /* one for each lane */
#define LMOC_TIME(time, lane) ((time)[lane])
#else
#define LMOC_NAME(name) name
typedef double lmoc_times;
#define LMOC_TIME(time, lane) (time)
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

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define LMOC_WIDEST __attribute__((target_clones("avx2", "default"))) /* the same bits, four at a time */
#else
#define LMOC_WIDEST
#endif

#ifdef __GNUC__
#define LMOC_INLINE static inline __attribute__((always_inline))
#else
#define LMOC_INLINE static inline
#endif

#endif
