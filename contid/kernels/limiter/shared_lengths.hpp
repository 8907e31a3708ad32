// Limits that the lengths of a chain of sections share: three racks where they have a budget R, then a bend a section,
//
//     e = sum l - R        and        e = r (|(u, v)| - kappa_max L)        with (u, v, L) linear in its three lengths;
//
// contid/kinematics/arc/feasible.py has the same limits, with those of single lengths.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace contid {

// The length of (a, b), rounded correctly but for one case in millions: libraries differ in its last bit.
inline double hypotenuse(double a, double b) {
  const double aa = a * a, bb = b * b, h = std::sqrt(aa + bb), hh = h * h;
  if (!(h > 0.0)) return h;
  const double left = (std::max(aa, bb) - hh) + std::min(aa, bb);
  const double lost = std::fma(a, a, -aa) + std::fma(b, b, -bb) - std::fma(h, h, -hh);
  return h + (left + lost) / (2.0 * h);
}

struct SharedLengths {
  int sections, racks, bends;
  double rack_m, curvature_max;
  std::vector<double> radius_m, to_arc;  // per section; rows of u, v, L by the three lengths, (sections, 3, 3)

  int count() const { return racks + bends; }

  // By how much every limit is exceeded [m], negative inside; convex.
  void excess(const double* lengths, double* out) const {
    for (int j = 0; j < racks; ++j) {
      double sum = 0.0;
      for (int s = 0; s < sections; ++s) sum += lengths[3 * s + j];
      out[j] = sum - rack_m;
    }
    for (int s = 0; s < bends; ++s) {
      double arc[3];
      arc_of(lengths, s, arc);
      out[racks + s] = radius_m[s] * (hypotenuse(arc[0], arc[1]) - curvature_max * arc[2]);
    }
  }

  // Derivative of one excess by the lengths, (3 sections).
  void gradient(const double* lengths, int number, double* out) const {
    for (int k = 0; k < 3 * sections; ++k) out[k] = number < racks && k % 3 == number ? 1.0 : 0.0;
    if (number < racks) return;
    const int s = number - racks;
    double arc[3];
    arc_of(lengths, s, arc);
    const double size = hypotenuse(arc[0], arc[1]), theta = size != 0.0 ? size : 1.0;
    const double* rows = &to_arc[9 * s];
    for (int k = 0; k < 3; ++k)
      out[3 * s + k] =
          radius_m[s] * (arc[0] / theta * rows[k] + arc[1] / theta * rows[3 + k] - curvature_max * rows[6 + k]);
  }

 private:
  void arc_of(const double* lengths, int section, double* arc) const {
    const double* l = lengths + 3 * section;
    const double* rows = &to_arc[9 * section];
    for (int i = 0; i < 3; ++i) arc[i] = rows[3 * i] * l[0] + rows[3 * i + 1] * l[1] + rows[3 * i + 2] * l[2];
  }
};

}  // namespace contid
