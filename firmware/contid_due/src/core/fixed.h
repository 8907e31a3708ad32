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

// Differences of counts wrap like the hardware counters do.
inline int32_t minus(int32_t a, int32_t b) {
  return static_cast<int32_t>(static_cast<uint32_t>(a) - static_cast<uint32_t>(b));
}
inline int32_t plus(int32_t a, int32_t b) {
  return static_cast<int32_t>(static_cast<uint32_t>(a) + static_cast<uint32_t>(b));
}

// Largest root with root * root <= value: 16 bits by Newton's method, 16 more by one division of the remainder
// (Zimmermann, Karatsuba square root, 1999). Divisions of 32 bits only: the chip has those in hardware.
inline uint32_t square_root(uint64_t value) {
  if (value == 0) return 0;
  const int shift = __builtin_clzll(value) & ~1;
  const uint64_t scaled = value << shift;
  const uint32_t high = static_cast<uint32_t>(scaled >> 32), low = static_cast<uint32_t>(scaled);
  uint32_t root = (high >> 17) + 0x6000;  // within 13 %
  root = (root + high / root) / 2;
  root = (root + high / root) / 2;
  root = (root + high / root) / 2;
  if (root > 0xFFFF || root * root > high) --root;
  const uint32_t rest = high - root * root;
  const uint32_t half = rest << 15 | low >> 17;
  const uint32_t part = half / root;
  const int64_t left = static_cast<int64_t>(half % root) << 17 | (low & 0x1FFFF);
  const int64_t square = static_cast<int64_t>(part) * part;
  const uint64_t whole = (static_cast<uint64_t>(root) << 16) + part - (left < square ? 1 : 0);
  return static_cast<uint32_t>(whole >> (shift / 2));
}

}  // namespace contid

#endif
