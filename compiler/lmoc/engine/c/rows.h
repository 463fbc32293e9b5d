/* What is asked of rows of numbers, one for each lane, in as few instructions as for one: the larger of two, and powers of two
   to some digits. The operations are those of every processor, so that the bits are the same everywhere. */

#ifndef LMOC_ROWS_H
#define LMOC_ROWS_H

#include "lane.h"

#if LMOC_LANES > 1
typedef uint64_t lmoc_bits __attribute__((vector_size(8*LMOC_LANES), aligned(8), may_alias));
#define LMOC_CHOOSE(which, a, b) lmoc_real_of(((lmoc_bits)(which) & lmoc_bits_of(a)) | (~(lmoc_bits)(which) & lmoc_bits_of(b)))
#else
typedef uint64_t lmoc_bits;
#define LMOC_CHOOSE(which, a, b) ((which) ? (a) : (b))
#endif

LMOC_INLINE lmoc_bits lmoc_bits_of(lmoc_real x) {
  lmoc_bits bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}

LMOC_INLINE lmoc_real lmoc_real_of(lmoc_bits bits) {
  lmoc_real x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

LMOC_INLINE lmoc_real lmoc_absolute(lmoc_real x) { return lmoc_real_of(lmoc_bits_of(x) & (uint64_t)0x7fffffffffffffff); }

/* What is left of a, and of b where that is larger; of what is no number: a, or what is none. */
LMOC_INLINE lmoc_real lmoc_larger(lmoc_real a, lmoc_real b) { return LMOC_CHOOSE(b > a, b, a); }
LMOC_INLINE lmoc_real lmoc_worse(lmoc_real a, lmoc_real b) { return LMOC_CHOOSE((b > a) | (b != b), b, a); }
LMOC_INLINE lmoc_real lmoc_smaller(lmoc_real a, lmoc_real b) { return LMOC_CHOOSE(b < a, b, a); }

/* Logarithm to 2e-5 of what is not negative: -1023 of zero, 1024 of infinity. */
LMOC_INLINE lmoc_real lmoc_log2(lmoc_real x) {
  const lmoc_bits bits = lmoc_bits_of(x);
  const lmoc_real whole = lmoc_real_of((bits >> 52) | (uint64_t)0x4330000000000000) - (0x1p52 + 1023);
  const lmoc_real m = lmoc_real_of((bits & (uint64_t)0xfffffffffffff) | (uint64_t)0x3ff0000000000000) - 1;
  const lmoc_real rest = 0.441836 + m*(-0.266536 + m*(0.147019 + m*-0.044244));
  return whole + (m + m*(1 - m)*rest);
}

/* Power of two to 1e-4, between the 1000th and its inverse. */
LMOC_INLINE lmoc_real lmoc_exp2(lmoc_real power) {
  const lmoc_real most = (lmoc_real){0} + 1000, p = lmoc_larger(lmoc_smaller(power, most), -most);
  const lmoc_real shifted = p + 0x1.8p52, f = p - (shifted - 0x1.8p52);
  const lmoc_real two = lmoc_real_of((lmoc_bits_of(shifted) << 52) + (uint64_t)0x3ff0000000000000);
  return two * (0.999929 + f*(0.693276 + f*(0.242604 + f*0.055089)));
}

#endif
