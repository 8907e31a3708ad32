// Fixed point arithmetic: clamp, sign, magnitude, square root.
#ifndef CONTID_FIXED_H
#define CONTID_FIXED_H

#include <stdint.h>

namespace contid {

inline int32_t clamp(int32_t value, int32_t min, int32_t max) {
  return value < min ? min : (value > max ? max : value);
}

inline int64_t clamp64(int64_t value, int64_t min, int64_t max) {
  return value < min ? min : (value > max ? max : value);
}

inline int32_t sign(int64_t value) { return (value > 0) - (value < 0); }

inline int32_t magnitude(int32_t value) { return value < 0 ? -value : value; }  // not of INT32_MIN

inline int64_t magnitude64(int64_t value) { return value < 0 ? -value : value; }

// Largest root with root * root <= value, bit by bit from the highest that can be set.
inline uint32_t square_root(uint64_t value) {
  if (value == 0) return 0;
  const int leading = __builtin_clzll(value);
  uint64_t bit = static_cast<uint64_t>(1) << ((63 - leading) & ~1);
  uint64_t root = 0;
  while (bit != 0) {
    if (value >= root + bit) {
      value -= root + bit;
      root = (root >> 1) + bit;
    } else {
      root >>= 1;
    }
    bit >>= 2;
  }
  return static_cast<uint32_t>(root);
}

}  // namespace contid

#endif
