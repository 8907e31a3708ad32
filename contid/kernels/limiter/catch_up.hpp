// The way of axes that cannot be on the answer to a live target: contid/control/tick/jerk_guard.py.
#pragma once

#include "../motion/pursuit.hpp"
#include "guard.hpp"

namespace contid {

// Shares of the velocity with which a tendon robot goes on before it stops, where its way leaves limits.
constexpr double kShares[] = {1.0, 0.3, 0.1};

class CatchUp {
 public:
  CatchUp(const Guard& guard, bool tendons)
      : tendons_(tendons),
        leaves_line_(guard.motion_rules > 7),
        h_(guard.period_s),
        lines_(static_cast<Lines>(std::max(0, std::min(guard.motion_rules - 1, 2)))),
        rates_{guard.axes, guard.velocity.data(), guard.acceleration.data(), guard.jerk.data()} {}

  // The state after a tick; true where a tendon robot stops before it goes on. `pace`: of the answer; `stops`: it
  // stops already; `viable`: whether the axes can stop inside every limit from a state.
  template <class Viable>
  bool after(const Moving& now, const double* answer, const double* pace, bool stops, Viable viable,
             Moving& found) const {
    if (tendons_) return tendons_after(now, answer, pace, stops, viable, found);
    AxisNumbers frame;
    frame_velocity(pace, rates_, frame);
    const auto fits = [&](bool any) { return any && viable(found); };
    if (fits(pursued(now, answer, frame, rates_, h_, true, lines_, found)) ||
        fits(pursued(now, answer, frame, rates_, h_, false, lines_, found)) ||
        (lines_ != Lines::kNone && fits(kept_line(now, answer, rates_, h_, lines_, found))) ||
        stopped(now, viable, found))
      return false;
    if (!braked(now, rates_, h_, false, Lines::kNone, found)) coast(now, found);
    return false;
  }

 private:
  // From rest the way of tendons to an answer, which lies close to their limits, is a straight line of the pulls, in
  // which the limits are convex. In motion it may lead out of them: then the robot goes on more slowly, or stops before
  // it sets out again.
  template <class Viable>
  bool tendons_after(const Moving& now, const double* answer, const double* pace, bool stops, Viable viable,
                     Moving& found) const {
    for (const double share : kShares) {
      if (stops) break;
      AxisNumbers velocity, frame;
      for (int k = 0; k < rates_.axes; ++k) velocity[k] = share * rates_.velocity[k];
      const AxisRates slower{rates_.axes, velocity, rates_.acceleration, rates_.jerk};
      frame_velocity(pace, slower, frame);
      if (pursued(now, answer, frame, slower, h_, true, lines_, found) && viable(found)) return false;
    }
    if (leaves_line_ && stopped(now, viable, found)) return true;
    if (!braked(now, rates_, h_, true, lines_, found)) coast(now, found);
    return true;
  }

  // The state after a tick of the stop of all axes together from which they can stop; false for none. One that began
  // aside of a line goes on so where its rates come to be parallel.
  template <class Viable> bool stopped(const Moving& now, Viable viable, Moving& found) const {
    return (braked(now, rates_, h_, true, lines_, found) && viable(found)) ||
           (leaves_line_ && braked(now, rates_, h_, true, Lines::kNone, found) && viable(found));
  }

  // The state after a tick in which accelerations go to zero, where ruckig finds no motion.
  void coast(const Moving& now, Moving& found) const {
    for (int k = 0; k < rates_.axes; ++k) {
      const double v = now.velocity[k], a = now.acceleration[k], most = rates_.jerk[k];
      const double jerk = -std::min(std::max(a / h_, -most), most);
      found.position[k] = now.position[k] + v * h_ + a * h_ * h_ / 2.0 + jerk * std::pow(h_, 3.0) / 6.0;
      found.velocity[k] = v + a * h_ + jerk * h_ * h_ / 2.0;
      found.acceleration[k] = a + jerk * h_;
    }
  }

  bool tendons_, leaves_line_;
  double h_;
  Lines lines_;
  AxisRates rates_;
};

}  // namespace contid
