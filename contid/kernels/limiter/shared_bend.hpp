// Limits that the two racks of a finger share, in its arc length S = (l + r) / 2 and the bend r - l of the racks:
//
//     e = +-(r - l) - w T / g(S)        and        e = S_min - S        with T = min(kappa_max S, 2 pi)
//
// where g is actual over commanded curvature, 1 + a S + b with S clamped to its identified range. The range of each
// rack is a limit of its axis; contid/kinematics/rack/finger_limits.py has them all.
#pragma once

#include <algorithm>

namespace contid {

struct SharedBend {
  double spacing_m, curvature_max, arc_min_m;
  double gain_per_m, gain_offset, gain_least_m, gain_greatest_m;

  static constexpr int kCount = 3;

  // By how much every limit is exceeded [m], negative inside: bend to +x, bend to -x, arc length.
  void excess(const double* racks, double* out) const {
    const double arc_m = 0.5 * (racks[0] + racks[1]), bend = racks[1] - racks[0], most = bound(arc_m);
    out[0] = bend - most, out[1] = -bend - most, out[2] = arc_min_m - arc_m;
  }

  // Derivative of one excess by the racks.
  void gradient(const double* racks, int number, double* out) const {
    if (number == 2) {
      out[0] = out[1] = -0.5;
      return;
    }
    constexpr double side_m = 1e-6;  // half a difference
    const double arc_m = 0.5 * (racks[0] + racks[1]), sign = number == 0 ? 1.0 : -1.0;
    const double shrink = -0.25 * (bound(arc_m + side_m) - bound(arc_m - side_m)) / side_m;
    out[0] = shrink - sign, out[1] = shrink + sign;
  }

 private:
  // Greatest difference of the racks at an arc length, without their range [m].
  double bound(double arc_m) const {
    const double turn = std::min(curvature_max * arc_m, 6.283185307179586);
    const double gain = 1.0 + gain_per_m * std::min(std::max(arc_m, gain_least_m), gain_greatest_m) + gain_offset;
    return spacing_m * turn / gain;
  }
};

}  // namespace contid
