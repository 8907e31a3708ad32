// Forward statics: the base moment that brings a rod with given pressures into balance with its loads, by Newton's
// method from a given start. Which of several equilibria counts is decided in branch.hpp.
#pragma once

#include "rod.hpp"

namespace contid {

constexpr double kStatics = 1e-9;    // moment balance that counts as equilibrium [N*mm]
constexpr double kRounding = 1e-12;  // the same, as a part of the moment of all loads, where that is more
constexpr int kNewtonSteps = 25;

inline bool finite(Vec a) { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }

// Newton on the base moment at fixed pressures; `out` keeps the sweep with derivatives.
inline bool newton(const Rod& rod, const double* pressures, Vec& moment, Vec tip_force, double share, int elements,
                   Sweep& out) {
  sweep(rod, pressures, moment, tip_force, share, elements, out);
  for (int i = 0; i < kNewtonSteps; ++i) {
    const double error = norm(out.moment);
    if (error <= kStatics) return true;
    Mat inv;
    if (!std::isfinite(error) || !inverse(first_columns(out.residual), inv)) return false;
    const Vec full = inv * out.moment, from = moment;
    bool better = false;
    for (double fraction = 1.0; fraction > 0.05 && !better; fraction *= 0.5) {
      moment = from - fraction * full;
      sweep(rod, pressures, moment, tip_force, share, elements, out);
      better = norm(out.moment) < error;
    }
    if (!better) {
      moment = from;
      sweep(rod, pressures, moment, tip_force, share, elements, out);
      return false;
    }
  }
  return norm(out.moment) <= kStatics;
}

}  // namespace contid
