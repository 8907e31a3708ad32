// Limits with flat faces only, for the steps whose metric has the curvature of the cones.
#pragma once

#include "feasible.hpp"

namespace contid::section_build {

// The same limits with every cone replaced by its tangent plane at one point: all of them are flat.
struct TangentLimits {
  const Feasible& feasible;
  double normals[kMaxSections][kMaxLengths];
  double offsets[kMaxSections];

  TangentLimits(const Feasible& feasible, const double* at) : feasible(feasible) {
    if (feasible.curvature_max == kInfinity) return;
    for (int s = 0; s < feasible.sections.count; ++s) {
      feasible.normal(at, feasible.flat() + s, normals[s]);
      offsets[s] = feasible.bend_excess(at, s) - along(s, at);
    }
  }

  double worst(const double* l, const LimitSet& held, int& number) const {
    number = 0;
    if (inside(l)) return -kInfinity;
    double most = feasible.worst_flat(l, held, number);
    if (feasible.curvature_max < kInfinity)
      for (int s = 0; s < feasible.sections.count; ++s) {
        const int plane = feasible.flat() + s;
        const double over = offsets[s] + along(s, l);
        if (over > most && !held[plane]) most = over, number = plane;
      }
    return most;
  }

  void normal(const double* l, int number, double* out) const {
    if (number < feasible.flat())
      feasible.normal(l, number, out);
    else
      std::memcpy(out, normals[number - feasible.flat()], feasible.size() * sizeof(double));
  }

 private:
  bool inside(const double* l) const {
    bool over = !feasible.inside_flat(l);
    for (int s = 0; !over && feasible.curvature_max < kInfinity && s < feasible.sections.count; ++s)
      over = offsets[s] + along(s, l) > kRounding;
    return !over;
  }

  double along(int s, const double* l) const {
    double sum = 0.0;
    for (int i = 3 * s; i < 3 * s + 3; ++i) sum += normals[s][i] * l[i];
    return sum;
  }
};

}  // namespace contid::section_build
