// One descent of the bounded inverse kinematics: damped steps, homing, and Newton out of reach.
//
// A step solves a quadratic programme over the limits (active_set.hpp), never clips:
//
//     far from the target:   min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2        (Sugihara's damping)
//     near the target:       home.hpp
//     not met:               newton.hpp
//
// The unknowns are the lengths [m] of the arm, three per section; d is a step of them. The task error e [m] and its
// derivatives J are those of section_task.hpp. Homing moves along the lengths that meet the target to those nearest
// to the middle of their ranges. `mu`, 1 at first, is raised where a step fails and lowered where one succeeds; w is
// the least damping.
//
// Damping: T. Sugihara, "Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method", IEEE
// Transactions on Robotics 27(5), 984-991, 2011, doi:10.1109/TRO.2011.2148230. It takes |e|^2 / 2, which has a unit:
// beside the singular values of J, near 1, its effect depends on the unit of e, and with millimetres it would stall.
// Here e is divided by the length ell, a fifth of the arm.
#pragma once

#include "home.hpp"

namespace contid::section_build {

constexpr double kNoStep = 1e-9;      // [m]: the descent ends where a step that fails is no longer
constexpr double kStationary = 1e-5;  // greatest slope of the error where it is stationary

class Descent {
 public:
  const Feasible feasible;
  const Tuning tuning;

  Descent(const Feasible& feasible, const Tuning& tuning)
      : feasible(feasible), tuning(tuning), homing_(feasible, tuning) {}

  void evaluate(const double* lengths, const Goal& goal, Task& task) const {
    task.evaluate(feasible.sections, tuning.ell, lengths, goal);
  }

  // Norm of the task error [m].
  double error(const double* lengths, const Goal& goal) const {
    Task task;
    evaluate(lengths, goal, task);
    return task.error;
  }

  // One start, in place; returns the error left [m] and adds the steps to `iterations`. `avoid` may be null;
  // `settling`: Newton steps where the target is not met, instead of those of the tuning.
  double run(double* lengths, const Goal& goal, int& iterations, const Avoid* avoid = nullptr,
             int settling = -1) const {
    Task task;
    evaluate(lengths, goal, task);
    return run_from(task, lengths, goal, iterations, avoid, settling);
  }

  // The same with the task at the start, which is changed.
  double run_from(Task& here, double* lengths, const Goal& goal, int& iterations, const Avoid* avoid = nullptr,
                  int settling = -1) const {
    double error = approach(here, lengths, goal, tuning.near * tuning.ell, iterations);
    if (error < tuning.near * tuning.ell && home(here, lengths, goal, error, iterations, avoid)) return error;
    error = approach(here, lengths, goal, tuning.tolerance, iterations);
    const int most = settling < 0 ? tuning.settling : settling;
    if (error > tuning.tolerance) error = settle(feasible, tuning, here, lengths, goal, iterations, most);
    if (error <= tuning.tolerance) home(here, lengths, goal, error, iterations, avoid);
    return error;
  }

  // True where the error does not fall to first order inside the limits (the conditions of Karush, Kuhn and Tucker):
  // the step against its gradient, held to them, vanishes.
  bool stationary(const Task& here, const double* lengths) const {
    double step[kMaxLengths], trial[kMaxLengths];
    here.gradient(feasible.size(), step);
    for (int i = 0; i < feasible.size(); ++i) step[i] = -step[i];
    bounded_step({nullptr, false}, lengths, feasible, nullptr, 0, 0.0, step);
    return moved(feasible, lengths, step, trial) <= kStationary * here.error;
  }

 private:
  Homing homing_;

  // In what follows `here` is the task at the lengths, before and after.

  // The settled lengths, in place, if the target is met there; else nothing changes.
  bool home(Task& here, double* lengths, const Goal& goal, double& error, int& iterations, const Avoid* avoid) const {
    if (tuning.home_steps == 0) return error <= tuning.tolerance;
    double settled[kMaxLengths];
    std::memcpy(settled, lengths, feasible.size() * sizeof(double));
    const double left = homing_.run(feasible, here, settled, goal, iterations, avoid);
    if (!(left <= tuning.tolerance)) return false;
    std::memcpy(lengths, settled, feasible.size() * sizeof(double));
    error = left;
    // Where homing ended on its steps or its merit, the target can be met better than the tolerance asks for.
    if (error > tuning.still_error) {
      evaluate(lengths, goal, here);
      error = approach(here, lengths, goal, tuning.still_error, iterations);
    }
    return true;
  }

  // Damped steps, in place, until the error is `enough` or progress ends; returns the error left [m].
  //     min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2
  double approach(Task& here, double* lengths, const Goal& goal, double enough, int& iterations) const {
    const int n = feasible.size();
    const Tuning& t = tuning;
    Task next;
    double mu = 1.0;
    for (int iteration = 0; iteration < t.iterations && here.error > enough; ++iteration) {
      ++iterations;
      double d[kMaxLengths], trial[kMaxLengths];
      const double damping = t.weight + mu * here.error * here.error / (2.0 * t.ell * t.ell);
      damped_step(feasible, here.J, here.e, here.rows, damping, lengths, {}, d);
      const double step = moved(feasible, lengths, d, trial);
      evaluate(trial, goal, next);
      if (next.error >= here.error) {
        if (step < kNoStep) break;
        mu *= 4.0;
        continue;
      }
      const bool slow = next.error > t.slow * here.error;
      std::memcpy(lengths, trial, n * sizeof(double));
      here = next;
      mu = std::max(0.25 * mu, 1e-6);
      if (slow && here.error > enough) break;
    }
    return here.error;
  }
};

}  // namespace contid::section_build
