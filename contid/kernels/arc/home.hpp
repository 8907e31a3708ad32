// Of all lengths that meet a target the ones nearest to home: sequential quadratic programming over the limits.
//
//     minimise  1/2 (l - home)^T M (l - home) + potential(l)   subject to   task(l) = target,  l feasible
//
// Home are the middle lengths of the ranges. The potential is that of obstacles (avoid.hpp), 0 where none are given.
// The limits of bend are cones in the lengths, all others are planes.
//
// A step minimises a quadratic model with the linearised task as an equation (equation_step.hpp). Its metric is M at
// first (with the stiffness of the potential). Where steps stop shrinking it becomes the second derivative of the
// Lagrangian, with the curvature of task and bend cones, and the cones become their tangent planes. Steps must lower
// the merit `distance + penalty |e|`, e being the error of the task (Nocedal and Wright, Numerical Optimization, 2nd
// edition, chapter 18). So homing ends at a minimum, and solving again from an answer returns that answer.
#pragma once

#include "avoid.hpp"
#include "equation_step.hpp"
#include "newton.hpp"

namespace contid::section_build {

class Homing {
 public:
  Homing(const Feasible& feasible, const Tuning& tuning) : tuning_(tuning) {
    std::memcpy(home_factor_, feasible.metric, sizeof home_factor_);
    factor(home_factor_, feasible.size(), kMaxLengths);
  }

  // From lengths near the target, in place; returns the error left [m], above the tolerance when it is not met.
  // `avoid`: obstacles whose potential is added to the distance from home; may be null.
  // `begun`: the task at the lengths.
  double run(const Feasible& feasible, const Task& begun, double* lengths, const Goal& goal, int& iterations,
             const Avoid* avoid = nullptr) const {
    const int n = feasible.size();
    const Tuning& t = tuning_;
    Task tasks[2];
    const Task* at = &begun;
    Attraction here(feasible, lengths), there;  // to home: at the lengths, and at the trial where `compared`
    double metric[kMaxLengths * kMaxLengths], last_step = kInfinity, stiffness = 0.0;
    bool curved = false;  // the metric has the curvature of task and cones
    bool fresh = false;   // at these lengths
    const int most = avoid ? 2 * t.home_steps : t.home_steps;
    for (int k = 0; k < most; ++k) {
      ++iterations;
      const Task& task = *at;
      Task& next = tasks[at == tasks];  // the one that is not `at`
      double e[kMaxRows], z[kMaxLengths], d[kMaxLengths], y[kMaxRows], trial[kMaxLengths];
      task_error(task, goal, feasible.sections, e);
      double slope[kMaxLengths], near_factor[kMaxLengths * kMaxLengths];
      Factor whiten{home_factor_, true};
      std::memcpy(slope, here.slope, n * sizeof(double));
      const double push = avoid ? add_push(feasible, *avoid, lengths, slope, near_factor) : 0.0;
      if (push > 0.0 && factor(near_factor, n, kMaxLengths)) whiten = {near_factor, false};
      for (int i = 0; i < n; ++i) z[i] = slope[i];
      for (int a = 0; curved && a < task.rows; ++a)
        for (int i = 0; i < n; ++i) z[i] += stiffness * task.derivative(a, i) * e[a];
      double cones[kMaxSections] = {};
      if (curved) {
        const TangentLimits tangents(feasible, lengths);
        equation_step({feasible, &tangents}, task, e, z, lengths, {metric, false}, t.weight, d, y, cones);
      } else {
        equation_step(feasible, task, e, z, lengths, whiten, t.weight, d, y, cones);
      }
      // The step that the linear model predicts must close most of the error: else the target is not met here.
      double left = 0.0, met[kMaxRows];
      task.product(d, n, met);
      for (int a = 0; a < task.rows; ++a) left += (e[a] - met[a]) * (e[a] - met[a]);
      left = std::sqrt(left);
      const bool solvable = left <= kExact || left <= 0.1 * task.error;
      if (task.error > t.tolerance && left > kHopeless * task.error) return task.error;
      double step = moved(feasible, lengths, d, trial);
      if (k == 0 && step <= t.still && task.error <= t.still_error) return task.error;
      next.evaluate(feasible.sections, t.ell, trial, goal);
      const double penalty = kPenalty * std::sqrt(dot(y, y, task.rows));
      const double merit = here.distance + push + penalty * task.error;
      const double gain = dot(slope, d, n) + penalty * (task.error - left);
      bool compared = false;
      const auto lower = [&](double share) {
        const double pushed = avoid ? avoid->potential(feasible.sections, trial, nullptr, nullptr) : 0.0;
        there = Attraction(feasible, trial);
        compared = true;
        return there.distance + pushed + penalty * next.error <= merit - kDecrease * share * gain;
      };
      if (step > kNoise && !lower(1.0)) {
        // The curvature of the task, not the direction, can be what spoils a full step: meet the target again.
        double back[kMaxLengths], corrected[kMaxLengths];
        damped_step(feasible, next.J, next.e, next.rows, t.weight, trial, whiten, back);
        moved(feasible, trial, back, corrected);
        std::memcpy(trial, corrected, n * sizeof(double));
        next.evaluate(feasible.sections, t.ell, trial, goal);
        bool accepted = lower(1.0);
        if (!accepted && !fresh && solvable) {
          stiffness = curvature(feasible, lengths, goal, task, y, cones, slope, avoid, metric);
          curved = fresh = true;
          continue;
        }
        double share = 1.0;
        for (int cut = 0; !accepted && cut < kCuts; ++cut) {
          share *= 0.25;
          double shorter[kMaxLengths];
          for (int i = 0; i < n; ++i) shorter[i] = share * d[i];
          moved(feasible, lengths, shorter, trial);
          next.evaluate(feasible.sections, t.ell, trial, goal);
          accepted = lower(share);
        }
        if (!accepted) {
          if (!curved) return task.error;
          curved = false;  // the cones themselves instead of their tangent planes
          continue;
        }
        step = 0.0;
        for (int i = 0; i < n; ++i) step = std::max(step, std::fabs(trial[i] - lengths[i]));
      }
      const double before = task.error;
      std::memcpy(lengths, trial, n * sizeof(double));
      at = &next;
      here = compared ? there : Attraction(feasible, lengths);
      if (step <= t.home_tolerance && (at->error <= kExact || at->error > 0.5 * before)) return at->error;
      // Multipliers of a task that the limits keep from being met have no meaning.
      fresh = solvable && step > t.contraction * last_step;
      if (!solvable) curved = false;
      if (fresh) {
        std::memcpy(slope, here.slope, n * sizeof(double));
        if (avoid) add_push(feasible, *avoid, lengths, slope, near_factor);
        stiffness = curvature(feasible, lengths, goal, *at, y, cones, slope, avoid, metric);
        curved = true;
      }
      last_step = step;
    }
    return at->error;
  }

 private:
  static constexpr double kHopeless = 0.9;   // share of the error that a step must not leave
  static constexpr double kExact = 1e-10;    // error of a settled answer [m]
  static constexpr double kPenalty = 1.5;    // weight of the error in the merit, in multipliers of the task
  static constexpr double kDecrease = 1e-4;  // share of the predicted gain that a step must make
  static constexpr double kNoise = 1e-7;     // steps too short for the merit: its differences are rounding [m]
  static constexpr int kCuts = 6;

  const Tuning tuning_;
  double home_factor_[kMaxLengths * kMaxLengths];  // of the metric of home

  // Distance 1/2 (l - home)^T M (l - home) from home, and its negative gradient M (home - l). M has nothing between
  // two sections.
  struct Attraction {
    double slope[kMaxLengths], distance;
    Attraction() = default;
    Attraction(const Feasible& feasible, const double* lengths) {
      const int n = feasible.size();
      double away[kMaxLengths];
      for (int i = 0; i < n; ++i) away[i] = feasible.home[i] - lengths[i];
      for (int i = 0; i < n; ++i) {
        const int first = i - i % kColumns;
        slope[i] = dot(feasible.metric + i * kMaxLengths + first, away + first, kColumns);
      }
      distance = 0.5 * dot(away, slope, n);
    }
  };

  // slope -= gradient of the potential of obstacles, which is returned; `metric`: of home with its part.
  static double add_push(const Feasible& feasible, const Avoid& avoid, const double* lengths, double* slope,
                         double* metric) {
    double push[kMaxLengths];
    std::memcpy(metric, feasible.metric, sizeof feasible.metric);
    const double value = avoid.potential(feasible.sections, lengths, push, metric);
    for (int i = 0; i < feasible.size(); ++i) slope[i] -= push[i];
    return value;
  }

  // The error rows; of the direction's only what is across the tangent: no length changes the rest.
  void task_error(const Task& task, const Goal& goal, const Sections& sections, double* e) const {
    std::memcpy(e, task.e, sizeof task.e);
    if (kColumns == 2 && goal.mid) drop_normal(task, task.rows - 3, e);
    if (kColumns == 2 && sections.count == 1) drop_normal(task, 0, e);
    if (!goal.direction) return;
    double tangent[3];
    for (int k = 0; k < 3; ++k) tangent[k] = goal.direction[k] - task.e[3 + k] / tuning_.ell;
    const double along = dot(task.e + 3, tangent, 3);
    for (int k = 0; k < 3; ++k) e[3 + k] -= along * tangent[k];
  }

  // The end of one section of given length stays on a surface: only errors along it can be met.
  static void drop_normal(const Task& task, int row, double* e) {
    double normal[3], size = 0.0, out = 0.0;
    for (int k = 0; k < 3; ++k) {
      const int a = row + (k + 1) % 3, b = row + (k + 2) % 3;
      normal[k] = task.derivative(a, 0) * task.derivative(b, 1) - task.derivative(b, 0) * task.derivative(a, 1);
      size += normal[k] * normal[k];
      out += normal[k] * e[row + k];
    }
    for (int k = 0; size > 0.0 && k < 3; ++k) e[row + k] -= out / size * normal[k];
  }

  // H made stiff across the limits that bind and are pushed against.
  static void hold(const Feasible& feasible, const double* lengths, const Task& task, const double* y,
                   const double* cones, const double* slope, double* H) {
    const int n = feasible.size();
    double push[kMaxLengths], normal[kMaxLengths], most = 0.0;
    for (int i = 0; i < n; ++i) {
      push[i] = slope[i];
      for (int a = 0; a < task.rows; ++a) push[i] += task.derivative(a, i) * y[a];
      most = std::max(most, std::fabs(H[i * kMaxLengths + i]));
    }
    for (int number = 0; number < feasible.limits(); ++number) {
      const bool cone = number >= feasible.flat();
      if (cone ? cones[number - feasible.flat()] <= 0.0 : feasible.excess(lengths, number) <= -kBinding) continue;
      feasible.normal(lengths, number, normal);
      if (!cone && dot(normal, push, n) <= 0.0) continue;
      const double weight = 10.0 * most / dot(normal, normal, n);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) H[i * kMaxLengths + j] += weight * normal[i] * normal[j];
    }
  }

  // M stands for the metric of home, and the second derivative of the potential of obstacles is added to it.
  // The lower factor of M - sum_a y_a d2 task_a/dl2 + sum_s cones_s d2 cone_s/dl2, and the weight of J^T J that makes
  // it positive definite without changing steps that keep the task. Where that is not enough, limits that bind and a
  // multiple of M help.
  double curvature(const Feasible& feasible, const double* lengths, const Goal& goal, const Task& task, const double* y,
                   const double* cones, const double* slope, const Avoid* avoid, double* metric) const {
    constexpr double kForward = 1e-6;  // [m]; J^T y needs few digits
    const int n = feasible.size();
    double rows[kMaxLengths][kMaxLengths], at[kMaxLengths], H[kMaxLengths * kMaxLengths];
    std::memcpy(at, lengths, n * sizeof(double));
    double push[kMaxLengths], moved_push[kMaxLengths];
    const bool pushed = avoid && avoid->potential(feasible.sections, lengths, push, nullptr) > 0.0;
    for (int k = 0; k < n; ++k) {
      Task there;
      at[k] = lengths[k] + kForward;
      there.evaluate(feasible.sections, tuning_.ell, at, goal);
      if (pushed) avoid->potential(feasible.sections, at, moved_push, nullptr);
      at[k] = lengths[k];
      for (int i = 0; i < n; ++i) {
        double change = 0.0;
        for (int a = 0; a < task.rows; ++a) change += (there.derivative(a, i) - task.derivative(a, i)) * y[a];
        if (pushed) change -= moved_push[i] - push[i];
        rows[k][i] = feasible.metric[k * kMaxLengths + i] - change / kForward;
      }
    }
    double trace = 0.0, square = 0.0;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j) H[i * kMaxLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
      trace += feasible.metric[i * kMaxLengths + i];
    }
    for (int s = 0; s < feasible.sections.count; ++s)
      if (cones[s] > 0.0) feasible.add_cone(lengths, s, cones[s], H);
    for (int a = 0; a < task.rows; ++a) {
      double row = 0.0;
      for (int i = 0; i < n; ++i) row += task.derivative(a, i) * task.derivative(a, i);
      square += row;
    }
    double stiffness = 0.0, shift = 0.0;
    for (int attempt = 0;; ++attempt) {
      for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) {
          double value = H[i * kMaxLengths + j] + shift * feasible.metric[i * kMaxLengths + j];
          for (int a = 0; stiffness > 0.0 && a < task.rows; ++a)
            value += stiffness * task.derivative(a, i) * task.derivative(a, j);
          metric[i * kMaxLengths + j] = value;
        }
      if (factor(metric, n, kMaxLengths) || shift > kMaxShift) return stiffness;
      if (attempt < 3) {
        stiffness = attempt == 0 ? trace / square : 10.0 * stiffness;
      } else if (attempt == 3) {
        hold(feasible, lengths, task, y, cones, slope, H);
      } else {
        shift = shift == 0.0 ? 0.01 : 4.0 * shift;
      }
    }
  }
};

}  // namespace contid::section_build
