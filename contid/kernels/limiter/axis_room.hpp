// One axis in motion: how far it goes until it stands still, and whether its limits of position leave that room.
//
// It stops as soon as it can, with its acceleration at most `change` and its jerk at most `jolt`. Times are in ticks of
// the period h, as in `Axis`: for v, a and j in seconds, speed = v h, acceleration = a h^2 and jolt = j h^3.
#pragma once

#include <algorithm>
#include <cmath>

#include "axis.hpp"

namespace contid {

// A bound counts as kept up to this share of it: rounding.
constexpr double kKept = 1.0 + 1e-6;

// Way of a stop from a speed without acceleration: half the speed times its duration. The deceleration stays at
// `change` for a while, or returns to zero before it gets there.
inline double from_cruise(double speed, double change, double jolt) {
  const double ticks = speed * jolt >= change * change ? speed / change + change / jolt : 2.0 * std::sqrt(speed / jolt);
  return 0.5 * speed * ticks;
}

// The speed when an acceleration has been brought to zero at the full jerk.
inline double without_acceleration(double speed, double acceleration, double jolt) {
  return speed + 0.5 * acceleration * std::fabs(acceleration) / jolt;
}

// Way of a stop; speed and acceleration are towards the limit, the former not negative.
inline double stop_length(double speed, double acceleration, double change, double jolt) {
  const double top = speed + 0.5 * acceleration * acceleration / jolt;
  if (acceleration >= 0.0) {  // its speed grows to `top` until its acceleration is zero
    const double until_top = speed * acceleration / jolt + std::pow(acceleration, 3.0) / (3.0 * jolt * jolt);
    return until_top + from_cruise(top, change, jolt);
  }
  // It decelerates as in a stop that began at the speed `top` without acceleration, `ticks` ago.
  const double ticks = -acceleration / jolt;
  // The deceleration of that stop, jolt ticks, grows to the smaller of `change` and sqrt(top jolt). One above
  // sqrt(top jolt) stops the axis before it can be brought to zero, so within `ticks` and never faster than `speed`.
  // By motion rules before 3, one above `change` by rounding got the same way, too short for an axis that is fast.
  if (ticks > std::min(change / jolt, std::sqrt(top / jolt))) return speed * ticks;
  // The way of the whole stop, less what it has covered in `ticks`.
  return std::max(0.0, from_cruise(top, change, jolt) - (top * ticks - jolt * std::pow(ticks, 3.0) / 6.0));
}

// More than `stop_length`, without a root. A stop from `top` without acceleration takes top / change + change / jolt
// ticks at most, with half of `top` as its mean speed. An axis that accelerates gets to `top` in up to change / jolt
// ticks before it: with half of those of the stop, 1.5. One tick is added. Motion rules before 2 ignored acceleration.
inline double stop_length_bound(double speed, double acceleration, double change, double jolt, int motion_rules) {
  const bool speeds_up = motion_rules > 1 && acceleration > 0.0;
  const double top = speeds_up ? speed + 0.5 * acceleration * acceleration / jolt : speed;
  return top * (top / change + (speeds_up ? 1.5 : 1.0) * change / jolt + 1.0);
}

// Whether an axis at a position keeps its velocity and can stop within its limits of position.
inline bool viable(const Axis& axis, double jolt, double at, double speed, double acceleration, int motion_rules) {
  if (std::fabs(without_acceleration(speed, acceleration, jolt)) > axis.step * kKept) return false;
  double room = axis.upper - at;
  if (speed < 0.0) room = at - axis.lower, speed = -speed, acceleration = -acceleration;
  if (motion_rules > 2) acceleration = std::max(acceleration, -axis.change);  // one above `change` is so by rounding
  return room > stop_length_bound(speed, acceleration, axis.change, jolt, motion_rules) ||
         stop_length(speed, acceleration, axis.change, jolt) <= std::max(room, 0.0) + axis.change * 1e-6;
}

}  // namespace contid
