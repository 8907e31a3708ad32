// The shortest stop of several axes that end it together, each with its acceleration and jerk limited.
//
// From a speed v and an acceleration a, the acceleration goes at the full jerk j to a plateau p, stays there, and goes
// at the full jerk to zero. The speed changes by
//
//     dv = (p^2 - a^2) s / 2j + p t + p |p| / 2j,        s = sign(p - a),   t the time on the plateau,
//
// which has to be -v. Alone, an axis has no plateau unless p is its greatest acceleration. One that has more time T
// than it needs has a lower plateau: with t = T - |p - a| / j - |p| / j the change dv grows with p, is linear between 0
// and a, and solves p^2 - (j T + a) p + (j dv + a^2 / 2) = 0 above both; below both it is the mirror image of this. An
// axis that already brakes, and comes to rest in time when its acceleration goes to zero evenly, does that and waits.
//
// ruckig (L. Berscheid, T. Kroeger, RSS 2021) finds the same motions; tests/control/test_viability.py compares them.
#pragma once

#include <algorithm>
#include <cmath>

namespace contid {

struct AxisStop {
  double velocity, acceleration, jerk;  // at its begin, and the greatest
  double plateau, ramp_s, hold_s;

  double duration_s() const { return ramp_s + hold_s + std::fabs(plateau) / jerk; }

  struct Gone {
    double way, velocity;
  };

  // How far the axis has gone after a time of at most its duration.
  double way(double time_s) const { return after(time_s).way; }

  Gone after(double time_s) const {
    double x = 0.0, v = velocity, a = acceleration;
    const auto go = [&](double j, double longest_s) {
      const double t = std::min(time_s, longest_s);
      x += t * (v + t * (a / 2.0 + t * j / 6.0)), v += t * (a + t * j / 2.0), a += t * j;
      time_s -= t;
    };
    go(std::copysign(jerk, plateau - acceleration), ramp_s);
    go(0.0, hold_s);
    go(-std::copysign(jerk, plateau), std::fabs(plateau) / jerk);
    return {x, v};
  }
};

// The shortest stop of one axis.
inline AxisStop shortest_stop(double velocity, double acceleration, double greatest, double jerk) {
  const double level = acceleration * std::fabs(acceleration) / (2.0 * jerk);  // of v, when a goes to zero at once
  const double side = -velocity >= level ? 1.0 : -1.0, a = side * acceleration, dv = -side * velocity;
  double plateau = std::sqrt(std::max(jerk * dv + 0.5 * a * a, 0.0)), hold_s = 0.0;
  if (plateau > greatest) {
    plateau = greatest;
    const double ramps = a > greatest ? a * a : 2.0 * greatest * greatest - a * a;
    hold_s = std::max((dv - ramps / (2.0 * jerk)) / greatest, 0.0);
  }
  return {velocity, acceleration, jerk, side * plateau, std::fabs(plateau - a) / jerk, hold_s};
}

// The stop of one axis in a time that is no shorter than its shortest stop.
inline AxisStop stop_in(double velocity, double acceleration, double jerk, double time_s) {
  const double a = acceleration, dv = -velocity, level = a * std::fabs(a) / (2.0 * jerk);
  if (velocity * a < 0.0) {
    const double rest_s = -2.0 * velocity / a, lower = 0.5 * a * a / std::fabs(velocity);
    if (lower <= jerk && rest_s <= time_s) return {velocity, a, lower, 0.0, rest_s, time_s - rest_s};
  }
  const double left_s = time_s - std::fabs(a) / jerk;
  const auto outer = [&](double side) {
    const double b = jerk * time_s + side * a, c = jerk * side * dv + 0.5 * a * a;
    return side * 2.0 * c / (b + std::sqrt(std::max(b * b - 4.0 * c, 0.0)));
  };
  double plateau;
  if (dv > level + std::max(a, 0.0) * left_s) {
    plateau = outer(1.0);
  } else if (dv < level + std::min(a, 0.0) * left_s) {
    plateau = outer(-1.0);
  } else {
    plateau = left_s > 0.0 ? (dv - level) / left_s : 0.0;
  }
  const double ramp_s = std::fabs(plateau - a) / jerk;
  return {velocity, a, jerk, plateau, ramp_s, std::max(time_s - ramp_s - std::fabs(plateau) / jerk, 0.0)};
}

}  // namespace contid
