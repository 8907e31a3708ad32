// The states of a robot's axes from which they can stop inside every limit: of velocity, of position, and shared.
//
// Limits that axes share are convex functions e of the axes, positive beyond the limit; those of a tendon robot are its
// tensions, travels and bends, which are convex in its pulls as well. contid/control/tick/jerk_guard.py uses this on
// live streams, by the rules of motions of contid/control/tick/config.py. Axes are in m, Pa or rad.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "axis_records.hpp"
#include "axis_room.hpp"
#include "joint_stop.hpp"

namespace contid {

// Greatest slope of a shared limit along one axis, which SharedLimits of contid/control/tick/shared_limits.py promises.
constexpr double kSteepest = 2.0;
// Excess of a position that is rounding [m], and of a tension: LIMIT_TOLERANCE_M of contid/units.py.
constexpr double kRoundingM = 1e-12, kToleranceM = 1e-9;
// By motion rules before 3, an axis had at least this share of its greatest velocity in the estimate of its stop.
constexpr double kSlow = 0.05;
// Rounding of a number of ticks.
constexpr double kRoundedTicks = 1e-6;
// By motion rules before 8, the states of a stop that are compared with shared limits, and where it comes close to
// their bounds: an axis that still accelerates leads beyond them early in its stop, and tensions have corners.
constexpr int kStates = 4, kStatesClose = 32;

struct Guard {
  int axes, own;  // of them the model's
  double period_s;
  int motion_rules;
  std::vector<Axis> limits;
  std::vector<double> velocity, acceleration, jerk;  // the greatest, per s, s^2 and s^3

  double jolt(int k) const { return jerk[k] * period_s * period_s * period_s; }

  // Whether an axis can go on from a state and stop within its limits of position; speed and acceleration per tick.
  bool axis_viable(int k, double at, double speed, double acceleration) const {
    return viable(limits[k], jolt(k), at, speed, acceleration, motion_rules);
  }

  bool all_viable(const Moving& at) const {
    for (int k = 0; k < axes; ++k)
      if (!axis_viable(k, at.position[k], at.velocity[k] * period_s, at.acceleration[k] * period_s * period_s))
        return false;
    return true;
  }

  // Whether every axis may be on its answer in this tick, and on it if it goes on in the two next. `last_steps` are
  // those before `steps`, the last; `paces` and `last_paces` how far the answer moved in this tick and the one before.
  bool on_answer(const double* answer, const double* last, const double* steps, const double* last_steps,
                 const double* paces, const double* last_paces) const {
    for (int k = 0; k < axes; ++k) {
      const double change = limits[k].change * kKept, most = jolt(k) * kKept;
      const double step = answer[k] - last[k], growth = paces[k] - last_paces[k];
      // Changes of the step: in the tick before, this one, and the two next, in which the pace of the answer grows on.
      const double changes[] = {steps[k] - last_steps[k], step - steps[k], paces[k] + growth - step, growth};
      if (std::fabs(step) > limits[k].step * kKept || std::fabs(changes[1]) > change || std::fabs(changes[2]) > change)
        return false;
      for (int n = 1; n < 4; ++n)
        if (std::fabs(changes[n] - changes[n - 1]) > most) return false;
      if (!axis_viable(k, answer[k], step + 0.5 * changes[1], changes[1])) return false;
    }
    return true;
  }

  // Whether axes that share limits can stop together inside them; `excess` is of the limit that is exceeded most. Where
  // the last command exceeds it, the axes may go on to do so as much.
  template <class Excess> bool stops_inside(const Moving& at, const double* last, bool taut, Excess excess) const {
    const double now = excess(at.position);
    if (!taut && -now > kSteepest * reach(at)) return true;
    const double allowed = std::max(excess(last), 0.0) + (taut ? kToleranceM : kRoundingM);
    if (now > allowed) return false;
    const auto keeps = [&](const JointStop& joint, int states, bool with_margin) {
      std::vector<double> ways(states * axes);
      for (int n = 0; n < states; ++n)
        if (!stays_between(at, last, joint, joint.duration_s * (n + 1) / states, &ways[n * axes])) return false;
      // With a margin, the larger excess of two neighbouring states, plus their difference, does not exceed the limits
      // either: this stands in for the states between the two, which are not computed.
      double before = now;
      for (int n = 0; n < states; ++n) {
        const double here = excess(&ways[n * axes]);
        const double between = with_margin ? std::max(before, here) + std::fabs(here - before) : here;
        if (!(between <= allowed)) return false;
        before = here;
      }
      return true;
    };
    const JointStop joint = joint_stop(at, velocity, acceleration, jerk, motion_rules > 1);
    if (!taut && motion_rules < 2) return keeps(joint, kStates, false);
    if (motion_rules < 8) return keeps(joint, kStates, true) || keeps(joint, kStatesClose, false);
    // A stop that is no line can come to rates that are parallel, after which that on the line is another one.
    const auto commanded = [&](const JointStop& stop) {
      return ticks_inside(at, last, stop, [&](const double* axes) { return excess(axes) <= allowed; });
    };
    return commanded(joint) || (joint.line && commanded(joint_stop(at, velocity, acceleration, jerk, false)));
  }

 private:
  // Whether the commands of a stop are inside, one per tick. Those of the stop that is left after a tick are the same.
  template <class Inside>
  bool ticks_inside(const Moving& at, const double* last, const JointStop& joint, Inside inside) const {
    std::vector<double> found(axes);
    const int ticks = static_cast<int>(std::ceil(joint.duration_s / period_s - kRoundedTicks));
    for (int n = 1; n <= ticks; ++n)
      if (!stays_between(at, last, joint, std::min(n * period_s, joint.duration_s), found.data()) ||
          !inside(found.data()))
        return false;
    return true;
  }

  // Finds the axes at a time of their stop; false where one is outside its limits, and farther than the last command.
  bool stays_between(const Moving& at, const double* last, const JointStop& joint, double at_s, double* found) const {
    for (int k = 0; k < axes; ++k) {
      found[k] = at.position[k] + joint.shares[k] * joint.stops[k].way(at_s) * velocity[k];
      const double beyond =
          std::max(std::min(limits[k].lower, last[k]) - found[k], found[k] - std::max(limits[k].upper, last[k]));
      if (!(beyond <= kRoundingM)) return false;
    }
    return true;
  }

  // More than the sum of the ways of the axes that stop together: they take as long as the slowest, each at its top
  // speed at most.
  double reach(const Moving& at) const {
    if (motion_rules < 3) return reach_before_3(at);
    double stop_s = 0.0, sum = 0.0;
    const auto top = [&](int k) {
      return std::fabs(at.velocity[k]) + 0.5 * at.acceleration[k] * at.acceleration[k] / jerk[k];
    };
    for (int k = 0; k < own; ++k)
      stop_s = std::max(stop_s,
                        std::fabs(at.acceleration[k]) / jerk[k] + top(k) / acceleration[k] + acceleration[k] / jerk[k]);
    for (int k = 0; k < own; ++k) sum += top(k) * stop_s;
    return sum;
  }

  // An estimate, less than the way of an axis that is slow and accelerates.
  double reach_before_3(const Moving& at) const {
    double sum = 0.0;
    for (int k = 0; k < own; ++k) {
      const double v = std::fabs(at.velocity[k]), a = acceleration[k];
      sum += std::max(v, kSlow * velocity[k]) * (v / a + 2.0 * a / jerk[k]);
    }
    return sum;
  }
};

}  // namespace contid
