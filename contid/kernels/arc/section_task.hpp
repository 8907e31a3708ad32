// Goal of a chain of sections, its error and derivatives; all rows are lengths [m].
// Twin and specification: contid/kinematics/arc/task.py.
#pragma once

#include <algorithm>

#include "active_set.hpp"

namespace contid {

// Parameters of the solver: see Tuning of contid/kinematics/arc/task.py.
struct Tuning {
  double ell, tolerance, home_tolerance, weight, near;
  int home_steps;
  double contraction;
  double slow;
  int iterations, settling, starts, agreeing;
  double tracking, still, still_error;
};

struct Goal {
  const double* tip;
  const double* direction;  // may be null
  const double* mid;        // may be null
};

// e and J: tip, ell times the direction, mid-point.
struct Task {
  double e[kMaxRows];
  double J[kMaxRows][kMaxLengths];
  int rows;
  double error;  // |e|

  // e = (p* - p, ell (t* - t), m* - m);  J = (dp/dl, ell dt/dl = ell (spin x t), dm/dl)
  void evaluate(const Sections& sections, double ell, const double* lengths, const Goal& goal) {
    const int n = sections.size();
    Derivatives at;
    differentiate(sections, lengths, at, goal.mid != nullptr);
    for (int k = 0; k < 3; ++k) {
      e[k] = goal.tip[k] - at.frames.tip[k];
      std::memcpy(J[k], at.tip[k], n * sizeof(double));
    }
    rows = 3;
    if (goal.direction) {
      const double t[3] = {at.frames.rotation[2], at.frames.rotation[5], at.frames.rotation[8]};
      for (int k = 0; k < 3; ++k) {
        e[3 + k] = ell * (goal.direction[k] - t[k]);
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        for (int j = 0; j < n; ++j) J[3 + k][j] = ell * (at.spin[a][j] * t[b] - at.spin[b][j] * t[a]);
      }
      rows += 3;
    }
    if (goal.mid) {
      for (int k = 0; k < 3; ++k) {
        e[rows + k] = goal.mid[k] - at.frames.mid[k];
        std::memcpy(J[rows + k], at.mid[k], n * sizeof(double));
      }
      rows += 3;
    }
    error = std::sqrt(dot(e, e, rows));
  }

  // Of |e|^2/2: -J^T e.
  void gradient(int n, double* out) const {
    for (int i = 0; i < n; ++i) {
      out[i] = 0.0;
      for (int a = 0; a < rows; ++a) out[i] -= J[a][i] * e[a];
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

}  // namespace contid
