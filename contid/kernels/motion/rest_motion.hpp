// A jerk-limited motion to a goal at rest, from a position, velocity and acceleration.
#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "../limiter/axis_numbers.hpp"
#include "solver.hpp"

namespace contid {

// An axis is at its goal already where its way is shorter than that of this time at full speed [s]; a speed below this
// share of its limit, and an acceleration below it in the same scaled unit, are zero. For some of such values the
// solver finds no motion, and for others one away from the goal and back.
constexpr double kThere = 1e-8;
// A speed above its limit by rounding is set to the limit: the solver fails for one in eight problems where several
// axes are a few float64 steps above it.
constexpr double kSpeedRounding = 1e-9;
// Shares of the jerk limit, tried in turn. ruckig 0.19 finds no profile exactly at the border of two kinds: 5 mm at
// 1000 mm/s^2 and 20000 mm/s^3 just reach the acceleration.
constexpr double kRestJerks[] = {1.0, 1.0 - 1e-7, 1.0 - 1e-5};

// Of each axis [m, Pa or rad, and per s, s^2 and s^3]; `acceleration` is empty where there is none.
struct RestProblem {
  std::vector<double> start, velocity, acceleration, goal, fastest, most, jerk;
};

class RestMotion {
 public:
  // Throws std::invalid_argument with what the solver gave as its reason.
  RestMotion(const RestProblem& problem, bool straight)
      : scale_(problem.fastest), solver_(static_cast<int>(scale_.size())) {
    ScaledMotion& asked = solver_.asked();
    const bool accelerates =
        std::any_of(problem.acceleration.begin(), problem.acceleration.end(), [](double each) { return each != 0.0; });
    for (std::size_t k = 0; k < scale_.size(); ++k) {
      const double unit = scale_[k], here = problem.start[k] / unit, there = problem.goal[k] / unit;
      asked.goal[k] = there, asked.position[k] = std::fabs(here - there) <= kThere ? there : here;
      asked.velocity[k] = speed(problem.velocity[k] / unit);
      const double most = problem.most[k];
      const double a = accelerates ? std::min(std::max(problem.acceleration[k], -most), most) / unit : 0.0;
      asked.acceleration[k] = std::fabs(a) <= kThere ? 0.0 : a;
      asked.low[k] = -1.0, asked.top[k] = 1.0, asked.most[k] = most / unit, asked.jerk[k] = problem.jerk[k] / unit;
    }
    const Arrival arrival = straight ? Arrival::kStraight : Arrival::kTogether;
    std::string reason;
    for (const double share : kRestJerks)
      if ((reason = solver_.reason(Control::kPosition, arrival, share)).empty()) return;
    throw std::invalid_argument(reason);
  }

  double duration_s() const { return solver_.duration_s(); }

  // State of every axis at a time.
  void at(double time_s, Moving& found) const {
    const ScaledState& state = solver_.at(time_s);
    for (std::size_t k = 0; k < scale_.size(); ++k) {
      found.position[k] = state.position[k] * scale_[k], found.velocity[k] = state.velocity[k] * scale_[k];
      found.acceleration[k] = state.acceleration[k] * scale_[k];
    }
  }

  std::size_t axes() const { return scale_.size(); }

 private:
  // A scaled speed without the rounding at 0 and at the limit.
  static double speed(double value) {
    if (std::fabs(value) <= kThere) return 0.0;
    return 1.0 < std::fabs(value) && std::fabs(value) < 1.0 + kSpeedRounding ? std::copysign(1.0, value) : value;
  }

  std::vector<double> scale_;
  MotionSolver solver_;
};

}  // namespace contid
