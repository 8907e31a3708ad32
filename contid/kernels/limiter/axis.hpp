// The next command of one axis under its limits of position, velocity and acceleration.
//
// Work is done in steps, the difference of two consecutive commands: with the period h a velocity v is the step v h,
// and an acceleration a is the change of step c = a h^2. From a step s an axis that sheds c per tick still travels
// s - c, s - 2c, ...; so the greatest step that stops within the room d is
//
//     s = d / (n + 1) + n c / 2      with the greatest n for which  c n (n + 1) / 2 <= d,
//
// the discrete form of v <= sqrt(2 a d).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace contid {

// Which limit bound, as bits; contid/control/tick/limits.py names them.
constexpr int kPosition = 1, kVelocity = 2, kAcceleration = 4, kRefused = 8;

// A trajectory that runs exactly at a limit differs from it by rounding; this much is not "beyond".
constexpr double kSlack = 1.0 + 1e-9;

struct Axis {
  double lower, upper;  // [m, Pa or rad]
  double step;          // greatest difference of two consecutive commands
  double change;        // greatest difference of two consecutive steps
};

struct Steps {
  double low, high;
};

struct AxisCommand {
  double value;
  int flags;
};

// Greatest step that, shedding `change` per tick, stops within `room` (the step itself included).
inline double brake_step(double room, double change) {
  if (room <= 0.0) return 0.0;
  if (room == std::numeric_limits<double>::infinity()) return room;
  const double n = std::trunc((std::sqrt(1.0 + 8.0 * room / change) - 1.0) / 2.0);
  return room / (n + 1.0) + 0.5 * n * change;
}

// Whether what has made a step, and sheds `change` per tick, stops within `room`.
inline bool stops_within(double room, double step, double change) {
  const double n = std::trunc(step / change);
  return n * step - 0.5 * change * n * (n + 1.0) <= room + change * 1e-9;
}

// Outside, an axis goes no further out.
inline Axis widened(const Axis& axis, double last) {
  return {std::min(axis.lower, last), std::max(axis.upper, last), axis.step, axis.change};
}

// Least and greatest step in the next tick that every limit allows.
inline Steps allowed_steps(const Axis& limits, double last, double last_step) {
  const Axis axis = widened(limits, last);
  const double inwards = -brake_step(last - axis.lower, axis.change);
  const double outwards = brake_step(axis.upper - last, axis.change);
  const auto inside = [&](double end) {
    const double step = std::min(std::max(end, -axis.step), axis.step);
    return std::min(std::max(step, inwards), outwards);
  };
  return {inside(last_step - axis.change), inside(last_step + axis.change)};
}

// The command when the target itself cannot be commanded.
inline AxisCommand chased(const Axis& axis, double last, double last_step, double target, double target_step) {
  int flags = 0;
  double inside = last, asked = 0.0;
  if (std::isfinite(target)) {
    inside = std::min(std::max(target, axis.lower), axis.upper);
    if (inside != target) flags = kPosition, target_step = 0.0;
    if (!std::isfinite(target_step)) target_step = 0.0;
    const double pace = std::min(std::max(target_step, -axis.step), axis.step);
    const double gap = inside - last - pace;
    const double chase = brake_step(std::fabs(gap), axis.change);
    asked = chase >= std::fabs(gap) ? inside - last : pace + std::copysign(chase, gap);
  } else {
    flags = kRefused;
  }
  double step = std::min(std::max(asked, last_step - axis.change), last_step + axis.change);
  if (step != asked) flags |= kAcceleration;
  if (std::fabs(step) > axis.step) step = std::copysign(axis.step, step), flags |= kVelocity;
  // At a limit there is no room outwards: the position wins over the acceleration.
  const double braked =
      std::min(std::max(step, -brake_step(last - axis.lower, axis.change)), brake_step(axis.upper - last, axis.change));
  if (braked != step) flags |= kPosition;
  if (braked == inside - last) return {inside, flags};
  return {std::min(std::max(last + braked, axis.lower), axis.upper), flags};
}

// The next command of an axis from its last command and step, its target and how far that moves per tick. A target that
// no limit forbids is commanded itself, bit for bit, without flags; so is a step that brakes towards one, which no
// limit cuts. Outside its limits an axis goes inwards only with its target.
inline AxisCommand limit_axis(const Axis& limits, double last, double last_step, double target, double target_step) {
  const Axis axis = limits.lower <= last && last <= limits.upper ? limits : widened(limits, last);
  const double step = target - last, slack = axis.change * kSlack;
  if (axis.lower <= target && target <= axis.upper && std::fabs(step) <= axis.step * kSlack &&
      std::fabs(step - last_step) <= slack &&
      std::fabs(step - target_step) <= slack) {  // 0 once on target; arriving faster than this would overshoot
    const double room = step > 0.0 ? axis.upper - target : target - axis.lower;
    if (std::fabs(step) <= slack || stops_within(room, std::fabs(step), axis.change)) return {target, 0};
  }
  return chased(axis, last, last_step, target, target_step);
}

}  // namespace contid
