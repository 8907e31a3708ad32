// Goal of a chain of sections, its error and derivatives; all rows are lengths [m].
// They are the tip error, the mid-point error, and ell (t_target - t) for a direction, or ell phi with
// exp(phi) R = R_target for a rotation.
#pragma once

#include <algorithm>

#include "active_set.hpp"

namespace contid::section_build {

// phi with exp(phi) = target at^T; the angle is at most pi.
inline void turn_left(const double* target, const double* at, double* phi) {
  double r[9];  // target at^T
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      r[3 * i + j] = target[3 * i] * at[3 * j] + target[3 * i + 1] * at[3 * j + 1] + target[3 * i + 2] * at[3 * j + 2];
  const double v[3] = {0.5 * (r[7] - r[5]), 0.5 * (r[2] - r[6]), 0.5 * (r[3] - r[1])};  // sin times the axis
  const double s = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), c = 0.5 * (r[0] + r[4] + r[8] - 1.0);
  if (s > 1e-6) {
    const double scale = std::atan2(s, c) / s;
    for (int k = 0; k < 3; ++k) phi[k] = scale * v[k];
  } else if (c > 0.0) {
    std::memcpy(phi, v, sizeof v);
  } else {  // half a turn: R + 1 = 2 axis axis^T
    int k = r[4] > r[0] ? 1 : 0;
    if (r[8] > r[4 * k]) k = 2;
    const double size = std::sqrt(std::max(0.5 * (r[4 * k] + 1.0), 1e-300));
    for (int i = 0; i < 3; ++i)
      phi[i] = 3.14159265358979323846 * (i == k ? size : 0.25 * (r[3 * i + k] + r[3 * k + i]) / size);
  }
}

// e and J: tip, ell times the direction or the rotation vector left, mid-point. The gradient of |phi|^2/2 is exact with
// J = spin, because the derivative of exp maps phi to itself.
struct Task {
  double e[kMaxRows];
  Column J[kMaxRows / 3][kMaxLengths];  // three rows each
  int rows;
  double error;  // |e|

  double derivative(int row, int i) const { return J[row / 3][i][row % 3]; }

  // e = (p* - p, ell (t* - t), m* - m);  J = (dp/dl, ell dt/dl = ell (spin x t), dm/dl)
  void evaluate(const Sections& sections, double ell, const double* lengths, const Goal& goal) {
    const int n = sections.size();
    Derivatives at;
    differentiate(sections, lengths, at, goal.mid != nullptr);
    for (int k = 0; k < 3; ++k) e[k] = goal.tip[k] - at.frames.tip[k];
    std::memcpy(J[0], at.tip, n * sizeof(Column));
    rows = 3;
    if (goal.direction) {
      const double* r = at.frames.rotation;
      const Column t{r[2], r[5], r[8], 0.0};
      for (int k = 0; k < 3; ++k) e[3 + k] = ell * (goal.direction[k] - t[k]);
      for (int j = 0; j < n; ++j) {
        cross(at.spin[j], t, J[1][j]);
        J[1][j] *= ell;
      }
      rows += 3;
    }
    if (goal.rotation) {
      turn_left(goal.rotation, at.frames.rotation, e + rows);
      for (int k = 0; k < 3; ++k) e[rows + k] *= ell;
      for (int j = 0; j < n; ++j) J[rows / 3][j] = ell * at.spin[j];
      rows += 3;
    }
    if (goal.mid) {
      for (int k = 0; k < 3; ++k) e[rows + k] = goal.mid[k] - at.frames.mid[k];
      std::memcpy(J[rows / 3], at.mid, n * sizeof(Column));
      rows += 3;
    }
    error = std::sqrt(dot(e, e, rows));
  }

  // Of |e|^2/2: -J^T e.
  void gradient(int n, double* out) const {
    for (int i = 0; i < n; ++i) {
      out[i] = 0.0;
      for (int a = 0; a < rows; ++a) out[i] -= derivative(a, i) * e[a];
    }
  }

  // out = J d
  void product(const double* d, int n, double* out) const {
    for (int block = 0; 3 * block < rows; ++block) {
      Column sum{};
      for (int i = 0; i < n; ++i) sum += J[block][i] * d[i];
      for (int k = 0; k < 3; ++k) out[3 * block + k] = sum[k];
    }
  }
};

// trial = lengths + d, brought inside the limits; returns the maximum change.
inline double moved(const Feasible& feasible, const double* lengths, const double* d, double* trial) {
  const int n = feasible.size();
  double step = 0.0;
  for (int i = 0; i < n; ++i) trial[i] = lengths[i] + d[i];
  feasible.pull(trial);
  for (int i = 0; i < n; ++i) step = std::max(step, std::fabs(trial[i] - lengths[i]));
  return step;
}

}  // namespace contid::section_build
