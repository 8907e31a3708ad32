// The lengths l a chain of sections may take: a convex set. Its limits have numbers, in the order of
// contid/kinematics/arc/feasible.py, which names them; n = size() lengths, N sections. Of limit
//
//     0 .. n-1           low_i - l_i            least length           } flat: linear in l
//     n .. 2n-1          l_i - high_i           greatest length        }
//     2n .. 2n+2         sum_s l_sj - rack      rack j of all sections }
//     2n+3 .. 2n+2+N     d (theta - kappa_max L)   bend of a section, a cone; theta = |(u, v)|
//
// the excess [m] is positive where it is exceeded.
#pragma once

#include <bitset>
#include <limits>

#include "sections.hpp"

namespace contid::section_build {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kBinding = 1e-9;    // a limit binds when less than this is left of it [m]
constexpr double kRounding = 1e-12;  // excess that counts as rounding [m]; the caller pulls the rest inside

using LimitSet = std::bitset<64>;

struct Feasible {
  Sections sections;
  double low[kMaxLengths], high[kMaxLengths];
  double home[kMaxLengths];                  // straight, well inside every limit
  double metric[kMaxLengths * kMaxLengths];  // of the distance from home, which resolves redundancy
  double rack = kInfinity;                   // maximum sum of one rack's lengths [m]
  double curvature_max = kInfinity;          // [1/m]

  int size() const { return sections.size(); }
  int flat() const { return 2 * size() + 3; }  // limits before the cones
  int limits() const { return flat() + sections.count; }

  // No tip is farther from the base than this.
  double longest() const {
    double sum = 0.0, rigid = 0.0;
    for (int s = 0; s < sections.count; ++s) sum += high[3 * s], rigid += sections.rigid[s];
    return std::fmin(sum, rack) + rigid;
  }

  double rack_excess(const double* l, int j) const {
    double sum = 0.0;
    for (int i = j; i < size(); i += 3) sum += l[i];
    return sum - rack;
  }

  double bend_excess(const double* l, int s) const {
    if (curvature_max == kInfinity) return -kInfinity;
    double uvl[3];
    sections.arc(l, s, uvl);
    return sections.radius[s] * (std::hypot(uvl[0], uvl[1]) - curvature_max * uvl[2]);
  }

  // True where the bend of a section is certainly within its limit: without the root, which takes the time of a step.
  bool certainly_bends(const double* l, int s) const {
    double uvl[3];
    sections.arc(l, s, uvl);
    const double most = curvature_max * uvl[2];
    return most > 0.0 && uvl[0] * uvl[0] + uvl[1] * uvl[1] < (1.0 - 1e-9) * (most * most);
  }

  // By how much one limit is exceeded [m], negative inside.
  double excess(const double* l, int number) const {
    const int n = size();
    if (number < n) return low[number] - l[number];
    if (number < 2 * n) return l[number - n] - high[number - n];
    if (number < flat()) return rack_excess(l, number - 2 * n);
    return bend_excess(l, number - flat());
  }

  // The flat limit exceeded most; those whose bit is set in `held` are left out.
  double worst_flat(const double* l, const LimitSet& held, int& number) const {
    double most = -kInfinity;
    number = 0;
    const int n = size();
    for (int i = 0; i < n; ++i) {
      const double below = low[i] - l[i];
      if (below > most && !held[i]) most = below, number = i;
    }
    for (int i = 0; i < n; ++i) {
      const double above = l[i] - high[i];
      if (above > most && !held[n + i]) most = above, number = n + i;
    }
    if (rack < kInfinity)
      for (int j = 0; j < 3; ++j) {
        const double over = rack_excess(l, j);
        if (over > most && !held[2 * n + j]) most = over, number = 2 * n + j;
      }
    return most;
  }

  // True where no flat limit is exceeded but for rounding.
  bool inside_flat(const double* l) const {
    bool over = false;
    for (int i = 0; i < size(); ++i) over |= (low[i] - l[i] > kRounding) | (l[i] - high[i] > kRounding);
    for (int j = 0; !over && rack < kInfinity && j < 3; ++j) over = rack_excess(l, j) > kRounding;
    return !over;
  }

  bool inside(const double* l) const {
    bool over = !inside_flat(l);
    for (int s = 0; !over && curvature_max < kInfinity && s < sections.count; ++s)
      over = !certainly_bends(l, s) && bend_excess(l, s) > kRounding;
    return !over;
  }

  // The limit exceeded most; cones are never left out. -infinity where none is exceeded but for rounding.
  double worst(const double* l, const LimitSet& held, int& number) const {
    number = 0;
    if (inside(l)) return -kInfinity;
    double most = worst_flat(l, held, number);
    if (curvature_max < kInfinity)
      for (int s = 0; s < sections.count; ++s) {
        if (certainly_bends(l, s)) continue;
        const double over = bend_excess(l, s);
        if (over > most) most = over, number = flat() + s;
      }
    return most;
  }

  // Gradient of one limit's excess.
  void normal(const double* l, int number, double* out) const {
    const int n = size();
    for (int i = 0; i < n; ++i) out[i] = 0.0;
    if (number < n) {
      out[number] = -1.0;
    } else if (number < 2 * n) {
      out[number - n] = 1.0;
    } else if (number < flat()) {
      for (int i = number - 2 * n; i < n; i += 3) out[i] = 1.0;
    } else {
      const int s = number - flat();
      double uvl[3];
      sections.arc(l, s, uvl);
      double theta = std::hypot(uvl[0], uvl[1]);
      if (theta == 0.0) theta = 1.0;
      const double along[3] = {uvl[0] / theta, uvl[1] / theta, -curvature_max};
      const double* m = sections.to_arc[s];
      for (int j = 0; j < 3; ++j)
        out[3 * s + j] = sections.radius[s] * (along[0] * m[j] + along[1] * m[3 + j] + along[2] * m[6 + j]);
    }
  }

  // H += weight d2 excess/dl2 of the cone of a section, the lower triangle; a straight section has none.
  void add_cone(const double* l, int s, double weight, double* H) const {
    double uvl[3];
    sections.arc(l, s, uvl);
    const double theta = std::hypot(uvl[0], uvl[1]);
    if (theta < 1e-9) return;
    const double* m = sections.to_arc[s];
    double across[3];  // of d(u, v)/dl, what turns the bend
    for (int j = 0; j < 3; ++j) across[j] = (uvl[0] * m[3 + j] - uvl[1] * m[j]) / theta;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j)
        H[(3 * s + i) * kMaxLengths + 3 * s + j] += weight * sections.radius[s] * across[i] * across[j] / theta;
  }

  // metric: 3 (L - L0)^2 + max(1.5 d^2, L0^2/2) theta^2 per section. The Euclidean distance of the lengths has 1.5 d^2
  // there, with which a thin arm bends instead of shortening: straight is nearest only while the weight of theta^2
  // exceeds (L0 - L) L.
  void weigh_home() {
    for (double& entry : metric) entry = 0.0;
    for (int s = 0; s < sections.count; ++s) {
      const double d = sections.radius[s], L = home[3 * s];
      const double bend = std::fmax(1.5 * d * d, 0.5 * L * L);
      const double* m = sections.to_arc[s];
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          metric[(3 * s + i) * kMaxLengths + 3 * s + j] =
              bend * (m[i] * m[j] + m[3 + i] * m[3 + j]) + 3.0 * m[6 + i] * m[6 + j];
    }
  }

  // Bits of the limits that bind.
  LimitSet binding(const double* l) const {
    LimitSet bits;
    for (int k = 0; k < limits(); ++k)
      if (excess(l, k) > -kBinding) bits.set(k);
    return bits;
  }

  // What is not a number becomes the least one.
  void clip(double* l) const {
    for (int i = 0; i < size(); ++i) l[i] = !(l[i] >= low[i]) ? low[i] : l[i] > high[i] ? high[i] : l[i];
  }

  // Bring l inside: clip it to its intervals, then pull it towards home until the other limits hold.
  void pull(double* l) const {
    clip(l);
    if (rack == kInfinity && curvature_max == kInfinity) return;
    double share = 1.0;
    for (int k = 2 * size(); k < limits(); ++k) {
      if (k >= flat() && (curvature_max == kInfinity || certainly_bends(l, k - flat()))) continue;
      const double there = excess(l, k);
      if (there > 0.0) {
        const double here = excess(home, k);
        const double reach = here / (here - there);
        if (reach < share) share = reach;
      }
    }
    if (share == 1.0) return;
    for (int i = 0; i < size(); ++i) l[i] = home[i] + share * (l[i] - home[i]);
    clip(l);
  }
};

}  // namespace contid::section_build
