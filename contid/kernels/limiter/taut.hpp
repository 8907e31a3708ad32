// The next command of the tendons of a robot that keeps every tension inside its bounds.
//
// The robot moves in the bends and the tightness of its sections, in which the limits are convex. After each step it
// can still stop on a straight line in these coordinates that ends inside every limit; as the limits are convex, all of
// that line is inside. From a step sigma of the coordinates the stop takes n ticks with the steps
//
//     sigma (1 - 1/n), sigma (1 - 2/n), ...,      whose sum is  sigma (n - 1) / 2.
//
// The axis that needs the most ticks to brake determines n. The next step lies between this stop and the motion to the
// answer, as near to the motion as the limits of axes and tensions allow; as the stop itself is allowed, there is
// always one. The idea is that of the safe sets of invariant braking: F. Blanchini, "Set invariance in control",
// Automatica 35(11), 1999.
//
// A step is the change of a value in one tick, the pace of a value is its step where it moves steadily.
#pragma once

#include "axis.hpp"
#include "taut_pulls.hpp"

namespace contid {

// A pull changes its pace along a straight line of bends and tightness, and this takes a part of the change of step
// that its axis may make. At least this share of it is left for braking:
constexpr double kMinBrakeShare = 0.2;
constexpr double kPlannedBrakeShare = 0.8;  // of an axis's change of step that a motion to the answer brakes with
constexpr double kDifference = 1e-3;        // the pace at an end of a line: difference quotient over this part of it
constexpr int kStopRounds = 5;              // in which the number of ticks of a stop is found
constexpr int kBisections = 8;              // between the stop and the motion to the answer
constexpr double kStillM = 1e-12;           // pulls that differ by less are equal up to rounding [m]
constexpr double kRounding = 1e-9;          // as a part of a change of step or in ticks
constexpr double kToleranceM = 1e-9;        // excess of a limit that is rounding [m]: contid.units.LIMIT_TOLERANCE_M

// A stop on a straight line of the coordinates.
struct Stop {
  double ticks;   // until rest
  Pulls pulls;    // at rest [m]
  Pulls varies;   // difference of the paces of each pull at the two ends of the line [m]
  Pulls fastest;  // bound of the step of each pull during the stop [m]
};

class TautLimiter {
 public:
  // From the last command and the last step of every tendon [m].
  TautLimiter(const TautPulls& taut, const Axis* axes, const double* pulls, const double* steps)
      : taut_(taut), axes_(axes), pulls_(pulls), steps_(steps), n_(taut.tendons), m_(taut.coordinates()) {
    Pulls before;
    for (int t = 0; t < n_; ++t) {
      lower_[t] = axes[t].lower, upper_[t] = axes[t].upper;
      before[t] = pulls[t] - steps[t];
    }
    Coordinates then;
    taut.split(pulls, at_);
    taut.split(before, then);
    for (int i = 0; i < m_; ++i) moved_[i] = at_[i] - then[i];
    Stop stop;
    stop_from(at_, moved_, stop);
    // A limit that is exceeded already, as after arming a robot bent by hand, may stay exceeded as much.
    double after[kMostLimits];
    excess(pulls, allowed_);
    excess(stop.pulls, after);
    for (int k = 0; k < taut.limits(); ++k) allowed_[k] = std::max(std::max(allowed_[k], after[k]), kToleranceM);
    for (int t = 0; t < n_; ++t) {
      may_vary_[t] = std::max(stop.varies[t], (1.0 - kMinBrakeShare) * axes[t].change);
      may_step_[t] = std::max(stop.fastest[t], axes[t].step);
    }
    braked_ = 1.0 - 1.0 / stop.ticks;
  }

  // Whether a command is inside every limit and the robot can stop after it inside them.
  bool keeps(const double* candidate) const {
    if (!inside(candidate)) return false;
    Coordinates there, step;
    taut_.split(candidate, there);
    for (int i = 0; i < m_; ++i) step[i] = there[i] - at_[i];
    Stop stop;
    stop_from(there, step, stop);
    for (int t = 0; t < n_; ++t)
      if (!(stop.varies[t] <= may_vary_[t] && stop.fastest[t] <= may_step_[t])) return false;
    return inside(stop.pulls);
  }

  // The command of the same bends with every tendon taut; false where the limits forbid it.
  bool tightened(const double* candidate, double* out) const {
    tighten(candidate, out);
    return allows(out);
  }

  // The command as near to the motion to the answer as the limits allow.
  void toward(const double* answer, const double* pace, double* out) const {
    Coordinates motion, trial;
    motion_to(answer, pace, motion);
    const auto between = [&](double share, double* pulls) {
      for (int i = 0; i < m_; ++i) {
        const double stop = moved_[i] * braked_;
        trial[i] = at_[i] + stop + share * (motion[i] - stop);
      }
      taut_.join(trial, pulls);
    };
    double low = 0.0, high = 1.0, share = 1.0;
    Pulls best, candidate;
    between(0.0, best);
    for (int k = 0; k < kBisections && low != high; ++k) {
      between(share, candidate);
      if (allows(candidate))
        low = share, std::copy_n(candidate, n_, best);
      else
        high = share;
      share = 0.5 * (low + high);
    }
    tighten(best, out);
    for (int t = 0; t < n_; ++t)
      out[t] = std::min(std::max(out[t], std::min(lower_[t], pulls_[t])), std::max(upper_[t], pulls_[t]));
  }

 private:
  static constexpr int kMostLimits = 5 * kMostTendons;

  void excess(const double* pulls, double* out) const { taut_.excess(pulls, lower_, upper_, out); }

  bool inside(const double* pulls) const {
    double over[kMostLimits];
    excess(pulls, over);
    for (int k = 0; k < taut_.limits(); ++k)
      if (!(over[k] <= allowed_[k])) return false;
    return true;
  }

  bool allows(const double* candidate) const {
    for (int t = 0; t < n_; ++t) {
      const Steps steps = allowed_steps(axes_[t], pulls_[t], steps_[t]);
      const double step = candidate[t] - pulls_[t], room = kRounding * axes_[t].change;
      if (!(step >= steps.low - room && step <= steps.high + room)) return false;
    }
    return keeps(candidate);
  }

  // Pulls of the same bends with every tendon taut; the last command where they differ by rounding.
  void tighten(const double* pulls, double* out) const {
    double least[kMostTendons];
    for (int s = 0; s < taut_.sections; ++s) least[s] = std::min(at_[2 * taut_.sections + s], 0.0);
    taut_.tightened(pulls, least, out);
    double off = 0.0;
    for (int t = 0; t < n_; ++t) off = std::max(off, std::fabs(out[t] - pulls_[t]));
    if (off < kStillM) std::copy_n(pulls_, n_, out);
  }

  // Step of the coordinates towards the answer: the pace of the answer, and a share of the gap to it such that all axes
  // can still brake.
  void motion_to(const double* answer, const double* pace, double* motion) const {
    Coordinates goal, along, gap;
    Pulls before, there;
    for (int t = 0; t < n_; ++t) before[t] = answer[t] - pace[t];
    taut_.split(answer, goal);
    taut_.split(before, along);
    for (int i = 0; i < m_; ++i) gap[i] = goal[i] - (along[i] = goal[i] - along[i]);
    taut_.join(gap, there);
    for (int t = 0; t < n_; ++t) {
      const double size = std::fabs(answer[t] - there[t]);
      if (size > axes_[t].step)
        for (int i = 0; i < m_; ++i) along[i] *= axes_[t].step / size;
    }
    for (int i = 0; i < m_; ++i) gap[i] = goal[i] - at_[i] - along[i];
    Pulls reach;
    reach_of(gap, reach);
    double share = 1.0;
    for (int t = 0; t < n_; ++t)
      if (reach[t] > 0.0)
        share = std::min(share, brake_step(reach[t], kPlannedBrakeShare * axes_[t].change) / reach[t]);
    // A stop from this motion goes on for (n - 1) / 2 steps, which must not lead beyond the answer, where the tightness
    // is least.
    for (int i = 0; i < m_; ++i) motion[i] = along[i] + share * gap[i];
    Stop stop;
    stop_from(at_, motion, stop);
    share = std::min(share, 2.0 / (stop.ticks + 1.0));
    for (int i = 0; i < m_; ++i) motion[i] = along[i] + share * gap[i];
  }

  // Bounds of the steps of the pulls [m] for a step of the coordinates: pulls are convex along it.
  void reach_of(const double* step, double* reach) const {
    Pulls here, there, begin, end;
    joined(at_, step, 0.0, here), joined(at_, step, 1.0, there);
    joined(at_, step, kDifference, begin), joined(at_, step, 1.0 - kDifference, end);
    for (int t = 0; t < n_; ++t)
      reach[t] = std::max(std::fabs((begin[t] - here[t]) / kDifference), std::fabs((there[t] - end[t]) / kDifference));
  }

  // The stop from coordinates `from` after a step `moved` of them. Pulls are convex along the line of the stop, so
  // their pace lies between that of the step and that at the end. The difference of these paces is not available for
  // braking.
  void stop_from(const double* from, const double* moved, Stop& stop) const {
    Pulls before, then, end, reach;
    joined(from, moved, 0.0, before), joined(from, moved, -1.0, then);
    for (int t = 0; t < n_; ++t) {
      before[t] -= then[t];
      reach[t] = std::fabs(before[t]), stop.varies[t] = 0.0;
    }
    stop.ticks = 1.0;
    for (int round = 0; round < kStopRounds; ++round) {
      double most = 0.0;
      for (int t = 0; t < n_; ++t) {
        const double change = axes_[t].change;
        most = std::max(most, reach[t] / std::max(change - stop.varies[t], kMinBrakeShare * change));
      }
      const double needed = std::max(1.0, std::ceil(most - kRounding));
      if (needed <= stop.ticks) break;
      stop.ticks = needed;
      const double on = 0.5 * (needed - 1.0);
      joined(from, moved, on, end), joined(from, moved, on - 1.0 / needed, then);
      for (int t = 0; t < n_; ++t) {
        const double after = needed * (end[t] - then[t]);
        reach[t] = std::max(std::fabs(before[t]), std::fabs(after));
        stop.varies[t] = std::fabs(after - before[t]);
      }
    }
    joined(from, moved, 0.5 * (stop.ticks - 1.0), stop.pulls);
    for (int t = 0; t < n_; ++t) stop.fastest[t] = (1.0 - 1.0 / stop.ticks) * reach[t];
  }

  // Pulls [m] of coordinates that have gone on by `times` a step.
  void joined(const double* from, const double* step, double times, double* pulls) const {
    Coordinates there;
    for (int i = 0; i < m_; ++i) there[i] = from[i] + times * step[i];
    taut_.join(there, pulls);
  }

  const TautPulls& taut_;
  const Axis* axes_;
  const double *pulls_, *steps_;
  int n_, m_;
  Pulls lower_, upper_, may_vary_, may_step_;
  Coordinates at_, moved_;  // coordinates of the last command, and their last step
  double allowed_[kMostLimits];
  double braked_;  // share of the last step that a stop begins with
};

}  // namespace contid
