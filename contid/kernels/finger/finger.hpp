// A two-rack finger. The equations are those of contid/kinematics/rack/{finger,finger_limits,planar_arc}.py, which
// answer what is out of reach; same operations in the same order, same bits. Units: m, rad.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace contid {

inline double sinc(double z) {
  if (std::fabs(z) < 1e-2) {
    const double q = z * z;
    return 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0));
  }
  return std::sin(z) / z;
}

inline double cosc(double z) {
  if (std::fabs(z) < 1e-2) {
    const double q = z * z;
    return z / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0)));
  }
  const double half = std::sin(z / 2.0);
  return 2.0 * half * half / z;
}

// a^2 as a sum of two doubles (Veltkamp and Dekker).
inline void square(double a, double& high, double& low) {
  const double t = a * 134217729.0, h = t - (t - a), l = a - h;
  high = a * a;
  low = ((h * h - high) + 2.0 * h * l) + l * l;
}

// sqrt(x^2 + y^2), correctly rounded but for one case in about 1e9, as Python's math.hypot is; C's is not.
inline double hypot(double x, double y) {
  const double a = std::max(std::fabs(x), std::fabs(y)), b = std::min(std::fabs(x), std::fabs(y));
  if (!(a > 0.0)) return a;
  int exponent;
  std::frexp(a, &exponent);
  const double m = std::ldexp(a, -exponent), n = std::ldexp(b, -exponent);
  double m2, m2_low, n2, n2_low, h2, h2_low;
  square(m, m2, m2_low);
  square(n, n2, n2_low);
  const double sum = m2 + n2, sum_low = (m2 - sum) + n2 + (m2_low + n2_low);
  const double h = std::sqrt(sum + sum_low);
  square(h, h2, h2_low);
  return std::ldexp(h + ((sum - h2) + (sum_low - h2_low)) / (2.0 * h), exponent);
}

struct Finger {
  double spacing, tip, gain_per_m, gain_offset, gain_low, gain_high;
  double length_min, length_max, curvature_max, arc_length_min;

  double gain(double arc_length) const {
    return 1.0 + gain_per_m * std::min(std::max(arc_length, gain_low), gain_high) + gain_offset;
  }

  // Arc length and turning angle of racks.
  void arc(const double* racks, double& arc_length, double& theta) const {
    arc_length = 0.5 * (racks[0] + racks[1]);
    theta = (racks[1] - racks[0]) / spacing * gain(arc_length);
  }

  // x and y of the tip, its direction (sin, cos).
  void forward(const double* racks, double* xy, double* direction) const {
    double s, theta;
    arc(racks, s, theta);
    direction[0] = std::sin(theta), direction[1] = std::cos(theta);
    xy[0] = s * cosc(theta) + tip * direction[0];
    xy[1] = s * sinc(theta) + tip * direction[1];
  }

  // Points of the arc and of the straight tip behind it at equal steps along both: x, y, 0 of each.
  void shape(const double* racks, int points, double* out) const {
    double s, theta;
    arc(racks, s, theta);
    const double sin = std::sin(theta), cos = std::cos(theta), length = s + tip, step = length / (points - 1);
    for (int k = 0; k < points; ++k) {
      const double at = k == 0 ? 0.0 : k + 1 == points ? length : k * step;
      const double on_arc = std::min(at, s), straight = at - on_arc;
      const double turned = s > 0.0 ? theta * on_arc / s : 0.0;
      out[3 * k] = on_arc * cosc(turned) + straight * sin;
      out[3 * k + 1] = on_arc * sinc(turned) + straight * cos;
      out[3 * k + 2] = 0.0;
    }
  }

  // The greatest commanded curvature at an arc length, of either sign.
  double curvature_bound(double arc_length) const {
    constexpr double pi = 3.14159265358979323846;
    const double g = gain(arc_length);
    const double by_racks =
        std::min(2.0 * (length_max / arc_length - 1.0) / spacing, 2.0 * (1.0 - length_min / arc_length) / spacing);
    return std::max(0.0, std::min(std::min(curvature_max / g, by_racks), 2.0 * pi / (arc_length * g)));
  }

  // The nearest feasible racks in arc length, then in curvature; feasible racks come back untouched.
  void clamp(const double* racks, double* out) const {
    constexpr double rounding = 1e-12;
    const double least = std::max(arc_length_min, length_min), asked = 0.5 * (racks[0] + racks[1]);
    double left = racks[0], right = racks[1];
    const auto commanded = [&](double arc_length) { return (racks[1] - racks[0]) / (spacing * arc_length); };
    const bool fits = least <= asked && asked <= length_max &&
                      std::fabs(commanded(asked)) <= curvature_bound(asked) * (1.0 + rounding);
    if (!fits) {
      const double s = std::min(std::max(asked, least), length_max), bound = curvature_bound(s);
      const double bend = 0.5 * spacing * std::min(std::max(commanded(s), -bound), bound) * s;
      left = s - bend, right = s + bend;
    }
    out[0] = std::min(std::max(left, length_min), length_max);
    out[1] = std::min(std::max(right, length_min), length_max);
  }

  // Arc length and curvature of the one arc that ends at (x, y); false where there is none.
  bool solve_arc(double x, double y, double& arc_length, double& curvature) const {
    constexpr double pi = 3.14159265358979323846;
    const double h = tip, d = x * x + (y - h) * (y + h), rho = hypot(x, y + h);
    if (d == 0.0 || rho == 0.0) {
      arc_length = curvature = 0.0;
      return x == 0.0 && y == h;
    }
    const double theta = 2.0 * std::atan2(x, y + h);
    curvature = 2.0 * x / d;
    if (d > 0.0) {
      arc_length = d / (rho * sinc(0.5 * theta));
      return std::fabs(theta) < 2.0 * pi;
    }
    arc_length =
        curvature != 0.0 ? (theta - std::copysign(2.0 * pi, x)) / curvature : std::numeric_limits<double>::infinity();
    return std::isfinite(arc_length);
  }

  // Racks for a tip within every limit; false for any other.
  bool inverse(double x, double y, double* racks, double& residual) const {
    constexpr double rounding = 1e-12;
    double s, k;
    if (!solve_arc(x, y, s, k)) return false;
    if (s < arc_length_min * (1.0 - rounding) || std::fabs(k) > curvature_max * (1.0 + rounding)) return false;
    const double slack = rounding * length_max, commanded = k / gain(s), bend = 0.5 * spacing * commanded * s;
    const double checked[2] = {s - bend, s + bend};
    for (const double length : checked)
      if (length > length_max + slack || length < length_min - slack) return false;
    const double turned = 0.5 * spacing * k / gain(s) * s;
    racks[0] = std::min(std::max(s - turned, length_min), length_max);
    racks[1] = std::min(std::max(s + turned, length_min), length_max);
    double xy[2], direction[2];
    forward(racks, xy, direction);
    residual = hypot(xy[0] - x, xy[1] - y);
    return true;
  }
};

}  // namespace contid
