// A step of homing: the quadratic programme with the linearised task as an equation.
#pragma once

#include "section_task.hpp"

namespace contid::section_build {

// minimise 1/2 d^T W d - z^T d with J d = e and l + d inside the limits; W by its lower factor `whiten`.
//     d = W^-1 (z + J^T y),    (J W^-1 J^T + w) y = e - J W^-1 z
// The weight w bounds y where the task is singular; what it leaves of e is asked for once more. `cones` gets the
// multipliers of the cones.
template <int Rows>
inline void equation_step_of(const Limits& limits, const Task& task, const double* e, const double* z, const double* at,
                             const Factor& whiten, double weight, double* d, double* y, double* cones) {
  const int n = limits.size();
  Whitened white;
  white.set<Rows>(task.J, z, whiten, n);
  double gram[kMaxRows * kMaxRows], free[kMaxLengths], asked[kMaxRows], held[kMaxRows], more[kMaxRows];
  for (int a = 0; a < Rows; ++a) {
    for (int b = 0; b <= a; ++b) gram[a * kMaxRows + b] = white.gram[a * kMaxRows + b];
    gram[a * kMaxRows + a] += weight;
    asked[a] = e[a] - white.across[a];
  }
  const bool regular = factor(gram, Rows, kMaxRows);
  for (int pass = 0; pass < 2; ++pass) {
    for (int a = 0; a < Rows; ++a) y[a] = regular ? asked[a] : 0.0;
    solve_lower(gram, Rows, kMaxRows, y);
    solve_upper(gram, Rows, kMaxRows, y);
    for (int a = 0; a < Rows; ++a) more[a] = weight * y[a];
    solve_lower(gram, Rows, kMaxRows, more);
    solve_upper(gram, Rows, kMaxRows, more);
    for (int a = 0; a < Rows; ++a) y[a] += more[a];
    white.combine<Rows>(y, n, d);
    whiten.upper(n, d);
    std::memcpy(free, d, n * sizeof(double));
    for (int s = 0; s < kMaxSections; ++s) cones[s] = 0.0;
    if (!bounded_step(whiten, at, limits, &white, Rows, weight, d, cones)) return;
    double most = 0.0;
    for (int i = 0; i < n; ++i) free[i] -= d[i];
    task.product(free, n, held);
    for (int a = 0; a < Rows; ++a) {
      held[a] /= weight;  // the limits' part of the multipliers
      most = std::max(most, std::fabs(held[a]));
      y[a] += held[a];
    }
    if (most == 0.0) return;
    for (int a = 0; a < Rows; ++a) asked[a] += weight * held[a];
  }
}

inline void equation_step(const Limits& limits, const Task& task, const double* e, const double* z, const double* at,
                          const Factor& whiten, double weight, double* d, double* y, double* cones) {
  with_rows(task.rows, [&](auto rows) {
    equation_step_of<decltype(rows)::value>(limits, task, e, z, at, whiten, weight, d, y, cones);
  });
}

}  // namespace contid::section_build
