// Limits of the pressures of a rod, three of each section from the base on [bar].
#pragma once

#include <algorithm>
#include <cmath>

#include "rod.hpp"

namespace contid {

struct Limits {
  int count;  // of the pressures
  double lower[kMost], upper[kMost], centre[kMost];
};

inline void clamp(const Limits& limits, double* p) {
  for (int i = 0; i < limits.count; ++i) p[i] = std::min(std::max(p[i], limits.lower[i]), limits.upper[i]);
}

// Greatest difference of n pressures [bar].
inline double most_change(int n, const double* p, const double* q) {
  double most = 0.0;
  for (int i = 0; i < n; ++i) most = std::fmax(most, std::fabs(p[i] - q[i]));
  return most;
}

// From equal pressures in each section a search for a tip on the axis stays on the axis until rounding chooses one of
// its mirrored solutions: of such a start the first two pressures are moved by once and twice this [bar], the same way
// on every processor.
constexpr double kOffAxis = 1e-6;

inline void leave_axis(const Limits& limits, double* p) {
  for (int i = 0; i < limits.count; i += 3) {
    const double most = std::max({p[i], p[i + 1], p[i + 2]}), least = std::min({p[i], p[i + 1], p[i + 2]});
    if (most - least >= kOffAxis) return;
  }
  for (int i = 0; i < 2; ++i) {
    const double step = (i + 1) * kOffAxis;
    p[i] += p[i] + step <= limits.upper[i] ? step : -step;
  }
}

}  // namespace contid
