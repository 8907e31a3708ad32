// A simulated device around its profile: the current that it draws, the heat of that, how long it bears its greatest
// current, and what it reports. Units are those of the device: rad or Pa and their derivatives by s; A, deg C.
#pragma once

#include "profile.hpp"

namespace contid {

// Friction of the gear, as a share of the greatest current, and the speed that it takes to be all of that.
constexpr double kFrictionShare = 0.05, kFrictionSpeed = 0.05;
constexpr double kAmbientC = 25.0, kThermalTauS = 120.0, kHeatingCPerA2 = 30.0;
// A motor board joins commands to a stream as its firmware does: those no farther apart than this and no faster than
// this times its top speed; its set-point goes on for this number of their intervals.
constexpr double kStreamGapS = 0.1, kStreamExcess = 2.5, kStreamIntervals = 2.0;

// A whole number of steps; +0.0, because a count has no sign of zero.
inline double in_steps(double value, double step) { return (std::nearbyint(value / step) + 0.0) * step; }

struct DeviceNumbers {
  double quantum, velocity_quantum;  // steps of positions and of the reported velocity, 0 for any velocity
  double lowest, highest;            // range of goals
  double acceleration;
  double current_limit_a, overload_s;  // 0 for devices without a current; how long it bears the greatest
  double amperes_per_lag;
  bool streams;  // a motor board
};

struct DeviceReading {
  double value, velocity, current_a, temperature_c;
};

struct SimulatedDevice : ProfileMotion {
  DeviceNumbers numbers;
  double top;  // greatest velocity
  bool powered = false;
  bool borne = false;  // a body holds the shaft, at an angle, which takes a current
  double shaft = 0.0, borne_a = 0.0;
  double temperature_c = kAmbientC, saturated_s = 0.0;
  double streamed, streamed_s = -std::numeric_limits<double>::infinity();  // the newest command of a stream

  SimulatedDevice(double time_s, double value, double tau_s, double top, const DeviceNumbers& numbers)
      : ProfileMotion(time_s, value, tau_s), numbers(numbers), top(top), streamed(value) {}

  // Current drawn: friction plus a share that grows with the lag, limited.
  double current_a() const {
    if (!powered) return 0.0;
    const double limit = numbers.current_limit_a, pull = numbers.amperes_per_lag * (reference().position - value);
    const double drawn = borne ? borne_a + (blocked ? pull : 0.0)
                               : pull + kFrictionShare * limit * std::tanh(velocity() / kFrictionSpeed);
    return std::min(limit, std::max(-limit, drawn));
  }

  // Advance to a later time; true when the greatest current was borne for too long.
  bool advance(double to_s) {
    const double dt = to_s - time_s;
    if (dt <= 0.0) return false;
    ProfileMotion::advance(to_s);
    if (numbers.current_limit_a <= 0.0) return false;
    const double current = current_a(), warmest = kAmbientC + kHeatingCPerA2 * current * current;
    temperature_c = warmest + (temperature_c - warmest) * std::exp(-dt / kThermalTauS);
    saturated_s = std::fabs(current) >= numbers.current_limit_a ? saturated_s + dt : 0.0;
    return saturated_s >= numbers.overload_s;
  }

  // Torque on: stays where it is, until the first command.
  void switch_on() {
    powered = true, streamed = value, streamed_s = -std::numeric_limits<double>::infinity();
    freeze();
  }

  // Goes to a goal, rounded to steps and clamped to the range; returns that.
  double command(double asked) {
    const double goal = in_steps(std::min(numbers.highest, std::max(numbers.lowest, asked)), numbers.quantum);
    const double last = streamed, gap_s = time_s - streamed_s;
    streamed = asked, streamed_s = time_s;
    if (numbers.streams && gap_s > 0.0 && gap_s <= kStreamGapS) {
      const double rate = (asked - last) / gap_s;
      if (std::fabs(rate) <= kStreamExcess * top) {
        go_with({goal, rate, time_s + kStreamIntervals * gap_s}, top, numbers.acceleration);
        return goal;
      }
    }
    go(goal, top, numbers.acceleration);
    return goal;
  }

  // What it reports now, with an error of the position.
  DeviceReading read(double noise) const {
    const double moving = velocity(), step = numbers.velocity_quantum;
    return {in_steps((borne ? shaft : value) + noise, numbers.quantum), step > 0.0 ? in_steps(moving, step) : moving,
            current_a(), std::nearbyint(temperature_c)};
  }
};

}  // namespace contid
