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

}  // namespace contid
