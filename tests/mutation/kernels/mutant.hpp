// One mutant of many is active in a process: `contid_mutant` chooses it, 0 is the program as it is.
#pragma once

#include <cmath>
#include <limits>
#include <type_traits>

extern "C" {
extern int contid_mutant;
extern unsigned char contid_mutant_reached[];
}

namespace contid_mutants {

inline bool is(int number) {
  contid_mutant_reached[number] = 1;
  return contid_mutant == number;
}

inline int sign(int number) { return is(number) ? -1 : 1; }

inline int factor(int number) { return is(number) ? 2 : 1; }

// The neighbour above (direction 1) or below (-1): it makes < of <=, or the reverse.
template <class T> T edge(int number, int direction, T value) {
  static_assert(std::is_arithmetic_v<T>, "an order is one of numbers");
  if (!is(number)) return value;
  if constexpr (std::is_floating_point_v<T>)
    return std::nextafter(value, direction * std::numeric_limits<T>::infinity());
  else
    return static_cast<T>(value + direction);
}

template <class T> T more(int number, T value) {
  static_assert(std::is_arithmetic_v<T> && !std::is_same_v<T, bool>, "a constant is a number");
  return is(number) ? static_cast<T>(value + 1) : value;
}

}  // namespace contid_mutants
