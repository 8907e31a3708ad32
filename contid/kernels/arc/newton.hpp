// Newton's method for a target that is not met, to the minimum of |e|^2/2 on the limits.
//
//     min 1/2 d^T H d - (J^T e)^T d over the limits,   H the second derivative of |e|^2/2
//
// It starts where the damped steps ended and stops when a step or the error vanishes, or after a given number of steps.
#pragma once

#include "section_task.hpp"

namespace contid::section_build {

// The shift is added to the diagonal of a Hessian that is not positive definite, as in Levenberg-Marquardt.
constexpr double kMinShift = 1e-3;
constexpr double kMaxShift = 1e12;  // a shift that makes any Hessian of an arm positive definite

// Hessian of |e|^2/2 by the lengths, from central differences of its gradient; the lower triangle.
inline void hessian(const Feasible& feasible, double ell, const double* lengths, const Goal& goal, double* H) {
  constexpr double kDifference = 1e-5;  // [m]: 1e-10 of truncation, 1e-11 of rounding
  const int n = feasible.size();
  double rows[kMaxLengths][kMaxLengths], at[kMaxLengths], up[kMaxLengths], down[kMaxLengths];
  std::memcpy(at, lengths, n * sizeof(double));
  for (int k = 0; k < n; ++k) {
    Task task;
    at[k] = lengths[k] + kDifference;
    task.evaluate(feasible.sections, ell, at, goal);
    task.gradient(n, up);
    at[k] = lengths[k] - kDifference;
    task.evaluate(feasible.sections, ell, at, goal);
    task.gradient(n, down);
    at[k] = lengths[k];
    for (int i = 0; i < n; ++i) rows[k][i] = (up[i] - down[i]) / (2.0 * kDifference);
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) H[i * kMaxLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
}

// H += sum w a a^T over the limits that bind and are pushed against: a Hessian that is indefinite only across such a
// limit then needs no shift.
inline void stiffen(const Feasible& feasible, const double* lengths, const double* push, double* H) {
  const int n = feasible.size();
  double most = 0.0, normal[kMaxLengths];
  for (int i = 0; i < n; ++i) most = std::max(most, std::fabs(H[i * kMaxLengths + i]));
  const LimitSet bits = feasible.binding(lengths);
  for (int k = 0; k < feasible.limits(); ++k) {
    if (!bits[k]) continue;
    feasible.normal(lengths, k, normal);
    if (dot(normal, push, n) <= 0.0) continue;
    const double weight = 10.0 * most / dot(normal, normal, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) H[i * kMaxLengths + j] += weight * normal[i] * normal[j];
  }
}

// whiten = F with F F^T = H + shift, the shift raised until F exists; false beyond kMaxShift.
inline bool shifted_factor(const double* H, int n, double& shift, double* whiten) {
  for (;;) {
    std::memcpy(whiten, H, kMaxLengths * kMaxLengths * sizeof(double));
    for (int i = 0; i < n; ++i) whiten[i * kMaxLengths + i] += shift + 1e-12;
    if (factor(whiten, n, kMaxLengths)) return true;
    shift = std::max(4.0 * shift, kMinShift);
    if (shift > kMaxShift) return false;
  }
}

// Takes steps d with H d = -gradient, shifted and within the limits, until they vanish or `most` iterations are done;
// returns the error left [m]. `here`: the task at the lengths, before and after.
inline double settle(const Feasible& feasible, const Tuning& tuning, Task& here, double* lengths, const Goal& goal,
                     int& iterations, int most) {
  const int n = feasible.size();
  Task next;
  double shift = 0.0, H[kMaxLengths * kMaxLengths], whiten[kMaxLengths * kMaxLengths];
  for (int iteration = 0; iteration < most; ++iteration) {
    ++iterations;
    double push[kMaxLengths];
    here.gradient(n, push);
    for (int i = 0; i < n; ++i) push[i] = -push[i];
    hessian(feasible, tuning.ell, lengths, goal, H);
    stiffen(feasible, lengths, push, H);
    if (!shifted_factor(H, n, shift, whiten)) return here.error;
    double d[kMaxLengths], trial[kMaxLengths];
    std::memcpy(d, push, sizeof d);
    solve_lower(whiten, n, kMaxLengths, d);
    solve_upper(whiten, n, kMaxLengths, d);
    bounded_step({whiten, false}, lengths, feasible, nullptr, 0, 0.0, d);
    const double step = moved(feasible, lengths, d, trial);
    next.evaluate(feasible.sections, tuning.ell, trial, goal);
    if (next.error >= here.error) {
      if (step < 1e-8) return here.error;
      shift = std::max(4.0 * shift, kMinShift);
      continue;
    }
    std::memcpy(lengths, trial, n * sizeof(double));
    here = next;
    if (here.error <= tuning.tolerance || step < 1e-9) return here.error;
    shift = shift > kMinShift ? 0.25 * shift : 0.0;
  }
  return here.error;
}

}  // namespace contid::section_build
