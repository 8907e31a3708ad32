// One descent of the bounded inverse kinematics: damped steps, homing, and Newton out of reach.
// Twin and specification: contid/kinematics/arc/descent.py: same decisions, same order.
#pragma once

#include "home.hpp"

namespace contid {

class Descent {
 public:
  const Feasible feasible;
  const Tuning tuning;

  Descent(const Feasible& feasible, const Tuning& tuning)
      : feasible(feasible), tuning(tuning), homing_(feasible, tuning) {}

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
    double error = approach(lengths, goal, tuning.near * tuning.ell, iterations);
    if (error < tuning.near * tuning.ell && home(lengths, goal, error, iterations, avoid)) return error;
    error = approach(lengths, goal, tuning.tolerance, iterations);
    const int most = settling < 0 ? tuning.settling : settling;
    if (error > tuning.tolerance) error = settle(feasible, tuning, lengths, goal, iterations, most);
    if (error <= tuning.tolerance) home(lengths, goal, error, iterations, avoid);
    return error;
  }

 private:
  Homing homing_;

  void evaluate(const double* lengths, const Goal& goal, Task& task) const {
    task.evaluate(feasible.sections, tuning.ell, lengths, goal);
  }

  // The settled lengths, in place, if the target is met there; else nothing changes.
  bool home(double* lengths, const Goal& goal, double& error, int& iterations, const Avoid* avoid) const {
    if (tuning.home_steps == 0) return error <= tuning.tolerance;
    double settled[kMaxLengths];
    std::memcpy(settled, lengths, feasible.size() * sizeof(double));
    const double left = homing_.run(feasible, settled, goal, iterations, avoid);
    if (!(left <= tuning.tolerance)) return false;
    std::memcpy(lengths, settled, feasible.size() * sizeof(double));
    error = left;
    // Where homing ended on its steps or its merit, the target can be met better than the tolerance asks for.
    if (error > tuning.still_error) error = approach(lengths, goal, tuning.still_error, iterations);
    return true;
  }

  // Damped steps, in place, until the error is `enough` or progress ends; returns the error left [m].
  //     min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2
  double approach(double* lengths, const Goal& goal, double enough, int& iterations) const {
    const int n = feasible.size();
    const Tuning& t = tuning;
    Task tasks[2];
    int now = 0;
    evaluate(lengths, goal, tasks[0]);
    double boost = 1.0;
    for (int iteration = 0; iteration < t.iterations && tasks[now].error > enough; ++iteration) {
      ++iterations;
      const Task& task = tasks[now];
      const double still[kMaxLengths] = {};
      double d[kMaxLengths], y[kMaxRows], trial[kMaxLengths];
      const double damping = t.weight + boost * task.error * task.error / (2.0 * t.ell * t.ell);
      damped_step(feasible, task.J, task.e, task.rows, damping, still, lengths, nullptr, d, y);
      const double step = moved(feasible, lengths, d, trial);
      Task& next = tasks[1 - now];
      evaluate(trial, goal, next);
      if (next.error >= task.error) {
        if (step < 1e-9) break;
        boost *= 4.0;
        continue;
      }
      const bool slow = next.error > t.slow * task.error;
      std::memcpy(lengths, trial, n * sizeof(double));
      now = 1 - now;
      boost = std::max(0.25 * boost, 1e-6);
      if (slow && tasks[now].error > enough) break;
    }
    return tasks[now].error;
  }
};

}  // namespace contid
