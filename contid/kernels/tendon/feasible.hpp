// The bends a tendon robot may take: planes of travel and tension, and a cone per section for its largest bend.
// Coordinates x are bends times section lengths [m], two per section.
// contid/kinematics/tendon/feasible.py makes and names the limits in the same order.
#pragma once

#include <bitset>
#include <limits>

#include "../arc/sections.hpp"

namespace contid::section_build {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kBinding = 1e-9;    // a limit binds when less than this is left of it [m]
constexpr double kRounding = 1e-12;  // excess that counts as rounding [m]; the caller pulls the rest inside
constexpr int kMaxPlanes = kMostPlanes;

using LimitSet = std::bitset<kMaxPlanes + kMaxSections>;

struct Feasible {
  Sections sections;
  double low[kMaxLengths], high[kMaxLengths];  // a box around the cones [m]
  double home[kMaxLengths] = {};               // the straight robot
  double metric[kMaxLengths * kMaxLengths];    // of the distance from home, which redundant robots minimise
  double bend_max[kMaxSections];               // [rad]
  int planes_count = 0;                        // normals . x <= offsets
  double normals[kMaxPlanes][kMaxLengths];
  double offsets[kMaxPlanes];

  int size() const { return sections.size(); }
  int flat() const { return planes_count; }
  int limits() const { return flat() + sections.count; }

  double longest() const {
    double sum = std::hypot(sections.offset[0], sections.offset[1]);
    for (int s = 0; s < sections.count; ++s) sum += sections.backbone[s] + sections.rigid[s];
    return sum;
  }

  double plane_excess(const double* x, int number) const {
    const double* normal = normals[number];
    double sum = 0.0;
    for (int i = 0; i < size(); ++i) sum += normal[i] * x[i];
    return sum - offsets[number];
  }

  // L (theta - theta_max) [m]
  double bend_excess(const double* x, int s) const {
    return std::hypot(x[2 * s], x[2 * s + 1]) - sections.backbone[s] * bend_max[s];
  }

  double excess(const double* x, int number) const {
    return number < flat() ? plane_excess(x, number) : bend_excess(x, number - flat());
  }

  // The plane exceeded most; those in `held` are left out.
  double worst_flat(const double* x, const LimitSet& held, int& number) const {
    double most = -kInfinity;
    number = 0;
    for (int k = 0; k < planes_count; ++k) {
      const double over = plane_excess(x, k);
      if (over > most && !held[k]) most = over, number = k;
    }
    return most;
  }

  // The limit exceeded most; cones are never left out.
  double worst(const double* x, const LimitSet& held, int& number) const {
    double most = worst_flat(x, held, number);
    for (int s = 0; s < sections.count; ++s) {
      const double over = bend_excess(x, s);
      if (over > most) most = over, number = flat() + s;
    }
    return most;
  }

  // Gradient of one limit's excess.
  void normal(const double* x, int number, double* out) const {
    if (number < flat()) {
      std::memcpy(out, normals[number], size() * sizeof(double));
      return;
    }
    for (int i = 0; i < size(); ++i) out[i] = 0.0;
    const double* bend = x + 2 * (number - flat());
    double length = std::hypot(bend[0], bend[1]);
    if (length == 0.0) length = 1.0;
    for (int i = 0; i < 2; ++i) out[2 * (number - flat()) + i] = bend[i] / length;
  }

  // H += weight d2 excess/dx2 of the cone of a section, the lower triangle; a straight section has none.
  void add_cone(const double* x, int s, double weight, double* H) const {
    const double a = x[2 * s], b = x[2 * s + 1], length = std::hypot(a, b);
    if (length < 1e-9) return;
    const double across[2] = {-b / length, a / length};
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j <= i; ++j) H[(2 * s + i) * kMaxLengths + 2 * s + j] += weight * across[i] * across[j] / length;
  }

  LimitSet binding(const double* x) const {
    LimitSet bits;
    for (int k = 0; k < limits(); ++k)
      if (excess(x, k) > -kBinding) bits.set(k);
    return bits;
  }

  // What is not a number becomes the least one.
  void clip(double* x) const {
    for (int i = 0; i < size(); ++i) x[i] = !(x[i] >= low[i]) ? low[i] : x[i] > high[i] ? high[i] : x[i];
  }

  // Bring x inside: clip it to the box, then straighten all bends by one factor until every limit holds.
  void pull(double* x) const {
    clip(x);
    double share = 1.0;
    for (int k = 0; k < limits(); ++k) {
      const double there = excess(x, k);
      if (there > 0.0) {
        const double here = excess(home, k);
        const double reach = here / (here - there);
        if (reach < share) share = reach;
      }
    }
    if (share == 1.0) return;
    for (int i = 0; i < size(); ++i) x[i] = share * x[i];
  }
};

// The same limits with every cone replaced by its tangent plane at one point: all of them are flat.
struct TangentLimits {
  const Feasible& feasible;
  double normals[kMaxSections][2];
  double offsets[kMaxSections];

  TangentLimits(const Feasible& feasible, const double* at) : feasible(feasible) {
    for (int s = 0; s < feasible.sections.count; ++s) {
      double row[kMaxLengths];
      feasible.normal(at, feasible.flat() + s, row);
      for (int i = 0; i < 2; ++i) normals[s][i] = row[2 * s + i];
      offsets[s] = feasible.bend_excess(at, s) - along(s, at);
    }
  }

  double worst(const double* x, const LimitSet& held, int& number) const {
    double most = feasible.worst_flat(x, held, number);
    for (int s = 0; s < feasible.sections.count; ++s) {
      const int plane = feasible.flat() + s;
      const double over = offsets[s] + along(s, x);
      if (over > most && !held[plane]) most = over, number = plane;
    }
    return most;
  }

  void normal(const double* x, int number, double* out) const {
    if (number < feasible.flat()) return feasible.normal(x, number, out);
    const int s = number - feasible.flat();
    for (int i = 0; i < feasible.size(); ++i) out[i] = 0.0;
    for (int i = 0; i < 2; ++i) out[2 * s + i] = normals[s][i];
  }

 private:
  double along(int s, const double* x) const { return normals[s][0] * x[2 * s] + normals[s][1] * x[2 * s + 1]; }
};

}  // namespace contid::section_build
