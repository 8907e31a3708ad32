// Newton's method for a target that is not met, to the minimum of |e|^2/2 on the limits.
// Twin and specification: Descent._settle of contid/kinematics/arc/descent.py.
#pragma once

#include "section_task.hpp"

namespace contid {

constexpr double kLeastShift = 1e-3;
constexpr double kHopeless = 1e12;  // a shift that makes any Hessian of an arm positive definite

// Of |e|^2/2, from central differences of its gradient; the lower triangle.
inline void hessian(const Feasible& feasible, double ell, const double* lengths, const Aim& aim, double* H) {
  constexpr double kDifference = 1e-5;  // [m]: 1e-10 of truncation, 1e-11 of rounding
  const int n = feasible.size();
  double rows[kMostLengths][kMostLengths], at[kMostLengths], up[kMostLengths], down[kMostLengths];
  std::memcpy(at, lengths, n * sizeof(double));
  for (int k = 0; k < n; ++k) {
    Task task;
    at[k] = lengths[k] + kDifference;
    task.look(feasible.sections, ell, at, aim);
    task.gradient(n, up);
    at[k] = lengths[k] - kDifference;
    task.look(feasible.sections, ell, at, aim);
    task.gradient(n, down);
    at[k] = lengths[k];
    for (int i = 0; i < n; ++i) rows[k][i] = (up[i] - down[i]) / (2.0 * kDifference);
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) H[i * kMostLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
}

// H += sum w a a^T over the limits that bind and are pushed against: the step will not cross them, so a Hessian
// that is negative only across such a limit needs no shift.
inline void stiffen(const Feasible& feasible, const double* lengths, const double* push, double* H) {
  const int n = feasible.size();
  double most = 0.0, normal[kMostLengths];
  for (int i = 0; i < n; ++i) most = std::max(most, std::fabs(H[i * kMostLengths + i]));
  for (std::uint64_t bits = feasible.binding(lengths), k = 0; bits >> k; ++k) {
    if (!(bits >> k & 1)) continue;
    feasible.normal(lengths, static_cast<int>(k), normal);
    if (dot(normal, push, n) <= 0.0) continue;
    const double weight = 10.0 * most / dot(normal, normal, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) H[i * kMostLengths + j] += weight * normal[i] * normal[j];
  }
}

// whiten = F with F F^T = H + shift, the shift raised until there is one; false when none will do.
inline bool shifted_factor(const double* H, int n, double& shift, double* whiten) {
  for (;;) {
    std::memcpy(whiten, H, kMostLengths * kMostLengths * sizeof(double));
    for (int i = 0; i < n; ++i) whiten[i * kMostLengths + i] += shift + 1e-12;
    if (factor(whiten, n, kMostLengths)) return true;
    shift = std::max(4.0 * shift, kLeastShift);
    if (shift > kHopeless) return false;
  }
}

// H d = -gradient, shifted and within the limits, until the steps vanish; returns the error left [m].
inline double settle(const Feasible& feasible, const Tuning& tuning, double* lengths, const Aim& aim, int& iterations) {
  const int n = feasible.size();
  Task tasks[2];
  int now = 0;
  tasks[0].look(feasible.sections, tuning.ell, lengths, aim);
  double shift = 0.0, H[kMostLengths * kMostLengths], whiten[kMostLengths * kMostLengths];
  for (int iteration = 0; iteration < tuning.settling; ++iteration) {
    ++iterations;
    const Task& task = tasks[now];
    double push[kMostLengths];
    task.gradient(n, push);
    for (int i = 0; i < n; ++i) push[i] = -push[i];
    hessian(feasible, tuning.ell, lengths, aim, H);
    stiffen(feasible, lengths, push, H);
    if (!shifted_factor(H, n, shift, whiten)) return task.error;
    double d[kMostLengths], trial[kMostLengths];
    std::memcpy(d, push, sizeof d);
    solve_lower(whiten, n, kMostLengths, d);
    solve_upper(whiten, n, kMostLengths, d);
    bounded_step(whiten, lengths, feasible, nullptr, 0, 0.0, d);
    const double step = moved(feasible, lengths, d, trial);
    Task& next = tasks[1 - now];
    next.look(feasible.sections, tuning.ell, trial, aim);
    if (next.error >= task.error) {
      if (step < 1e-8) return task.error;
      shift = std::max(4.0 * shift, kLeastShift);
      continue;
    }
    std::memcpy(lengths, trial, n * sizeof(double));
    now = 1 - now;
    if (next.error <= tuning.tolerance || step < 1e-9) return next.error;
    shift = shift > kLeastShift ? 0.25 * shift : 0.0;
  }
  return tasks[now].error;
}

}  // namespace contid
