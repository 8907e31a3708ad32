// Limits of the pressures [bar].
#pragma once

#include <algorithm>
#include <cmath>

namespace contid {

template <int K> struct Limits {
  double lower[3 * K], upper[3 * K], centre[3 * K];
};

template <int K> void clamp(const Limits<K>& limits, double* p) {
  for (int i = 0; i < 3 * K; ++i) p[i] = std::min(std::max(p[i], limits.lower[i]), limits.upper[i]);
}

// Greatest difference of two postures.
template <int K> double most_change(const double* p, const double* q) {
  double most = 0.0;
  for (int i = 0; i < 3 * K; ++i) most = std::fmax(most, std::fabs(p[i] - q[i]));
  return most;
}

// From equal pressures in each section a search for a tip on the axis stays on the axis until rounding chooses one of
// its mirrored solutions: such a start is moved off by this much [bar], the same way on every processor.
constexpr double kOffAxis = 1e-6;

template <int K> void leave_axis(const Limits<K>& limits, double* p) {
  for (int i = 0; i < 3 * K; i += 3) {
    const double most = std::max({p[i], p[i + 1], p[i + 2]}), least = std::min({p[i], p[i + 1], p[i + 2]});
    if (most - least >= kOffAxis) return;
  }
  for (int i = 0; i < 2; ++i) {
    const double step = (i + 1) * kOffAxis;
    p[i] += p[i] + step <= limits.upper[i] ? step : -step;
  }
}

}  // namespace contid
