// One descent of the bounded inverse kinematics: damped steps, homing, and Newton out of reach.
// Twin and specification: contid/kinematics/arc/descent.py: same decisions, same order.
#pragma once

#include "newton.hpp"

namespace contid {

class Descent {
 public:
  const Feasible feasible;
  const Tuning tuning;

  Descent(const Feasible& feasible, const Tuning& tuning) : feasible(feasible), tuning(tuning) {
    std::memcpy(home_factor_, feasible.metric, sizeof home_factor_);
    factor(home_factor_, feasible.size(), kMaxLengths);
  }

  // Norm of the task error [m].
  double error(const double* lengths, const Goal& goal) const {
    Task task;
    evaluate(lengths, goal, task);
    return task.error;
  }

  // One start, in place; returns the error left [m] and adds the steps to `iterations`.
  double run(double* lengths, const Goal& goal, int& iterations) const {
    double error = approach(lengths, goal, tuning.home_steps, iterations);
    if (error > tuning.tolerance) error = approach(lengths, goal, 0, iterations);
    if (error > tuning.tolerance) {
      error = settle(feasible, tuning, lengths, goal, iterations);
      if (error <= tuning.tolerance) error = approach(lengths, goal, tuning.home_steps, iterations);
    }
    return error;
  }

 private:
  double home_factor_[kMaxLengths * kMaxLengths];  // of the metric of home

  void evaluate(const double* lengths, const Goal& goal, Task& task) const {
    task.evaluate(feasible.sections, tuning.ell, lengths, goal);
  }

  // z = M a with a = home - lengths, shortened to `reach`.
  void home_gradient(const double* lengths, double reach, double* z) const {
    const int n = feasible.size();
    for (int i = 0; i < n; ++i) z[i] = feasible.home[i] - lengths[i];
    const double far = std::sqrt(dot(z, z, n));
    const double share = far > reach ? reach / far : 1.0;
    double away[kMaxLengths];
    for (int i = 0; i < n; ++i) away[i] = share * z[i];
    for (int i = 0; i < n; ++i) z[i] = dot(feasible.metric + i * kMaxLengths, away, n);
  }

  // Damped steps and homing, until the target is met or progress ends; the best lengths, in place.
  //     far from the target    min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2
  //     near the target        min |J d - e|^2 + w (d^T M d - 2 z^T d)
  double approach(double* best, const Goal& goal, int homes_left, int& iterations) const {
    const int n = feasible.size();
    const Tuning& t = tuning;
    Task tasks[2];
    int now = 0;
    double lengths[kMaxLengths];
    std::memcpy(lengths, best, n * sizeof(double));
    evaluate(lengths, goal, tasks[0]);
    double boost = 1.0, reach = t.ell, least = tasks[0].error;
    const double* home_factor = home_factor_;
    double metric[kMaxLengths * kMaxLengths];
    double last_step = kInfinity;
    for (int iteration = 0; iteration < t.iterations; ++iteration) {
      ++iterations;
      const Task& task = tasks[now];
      const bool homing = homes_left > 0 && task.error < t.near * t.ell;
      double z[kMaxLengths] = {}, d[kMaxLengths], y[kMaxRows], trial[kMaxLengths], damping = t.weight;
      if (homing) {
        --homes_left;
        home_gradient(lengths, reach, z);
      } else {
        damping += boost * task.error * task.error / (2.0 * t.ell * t.ell);
      }
      damped_step(feasible, task.J, task.e, task.rows, damping, z, lengths, homing ? home_factor : nullptr, d, y);
      const double step = moved(feasible, lengths, d, trial);
      Task& next = tasks[1 - now];
      evaluate(trial, goal, next);
      if (homing && next.error >= t.near * t.ell) {
        reach *= 0.25;
        continue;
      }
      if (!homing && next.error >= task.error && task.error > t.tolerance) {
        if (step < 1e-9) return least;
        boost *= 4.0;
        continue;
      }
      const bool slow = next.error > t.slow * task.error;
      std::memcpy(lengths, trial, n * sizeof(double));
      now = 1 - now;
      if (next.error < least || next.error <= t.tolerance) {
        std::memcpy(best, trial, n * sizeof(double));
        least = next.error;
      }
      if (homing && step > t.contraction * last_step) {
        home_metric(lengths, goal, next, y, metric);
        home_factor = metric;
      }
      last_step = homing ? step : kInfinity;
      if (!homing) boost = std::max(0.25 * boost, 1e-6);
      if (next.error <= t.tolerance && (!homing || step <= t.home_tolerance)) return next.error;
      if (!homing && slow && next.error > t.tolerance) return least;
    }
    return least;
  }

  // Second derivatives of |l - home|^2/2 - y^T task, shifted until positive definite: their factor.
  void home_metric(const double* lengths, const Goal& goal, const Task& task, const double* y, double* metric) const {
    constexpr double kForward = 1e-6;  // [m]; J^T y needs few digits
    const int n = feasible.size();
    double rows[kMaxLengths][kMaxLengths], at[kMaxLengths];
    std::memcpy(at, lengths, n * sizeof(double));
    for (int k = 0; k < n; ++k) {
      Task there;
      at[k] = lengths[k] + kForward;
      evaluate(at, goal, there);
      at[k] = lengths[k];
      for (int i = 0; i < n; ++i) {
        double change = 0.0;
        for (int a = 0; a < task.rows; ++a) change += (there.J[a][i] - task.J[a][i]) * y[a];
        rows[k][i] = feasible.metric[k * kMaxLengths + i] - change / kForward;
      }
    }
    for (double shift = 0.5, added = 0.0;; added = shift, shift *= 4.0) {
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j) metric[i * kMaxLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
        metric[i * kMaxLengths + i] += added;
      }
      if (factor(metric, n, kMaxLengths) || added > kMaxShift) return;
    }
  }
};

}  // namespace contid
