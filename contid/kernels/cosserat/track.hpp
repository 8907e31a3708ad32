// Descent from one command to the next, for solves in which the base moment is known beforehand.
//
// Without own weight the base moment in equilibrium is tip x force, and where the task is met the tip is the target:
// only the pressures are unknown, which saves the columns of the moment. For tasks without redundancy only. It ends in
// favour of the general solve when a step does not reduce the error tenfold; both have the same stopping rule, so they
// agree to the tolerance.
#pragma once

#include "solve.hpp"

namespace contid {

// False, with `out` undefined, where the general solve is needed.
inline bool track(const Rod& rod, const Task& task, Vec tip_force, const Limits& limits, const double* start,
                  int elements, double tolerance, Outcome& out) {
  const int n = rod.pressures();
  const int rows = task.rows();
  if (task.independent() < n) return false;
  const Vec moment = cross(task.tip, tip_force);
  double* p = out.pressures;
  for (int i = 0; i < n; ++i) p[i] = std::min(std::max(start[i], limits.lower[i]), limits.upper[i]);

  Sweep here(0);
  sweep(rod, p, moment, tip_force, 1.0, elements, here);
  double r[9], J[9][kMostColumns], H[kMost][kMost], g[kMost], low[kMost], high[kMost], d[kMost];
  jacobian(task, here, n, J);
  normal_matrix(n, J, rows, 0.0, H);

  const auto squared = [&](const Ends& ends) {
    residual(task, ends, r);
    double sum = 0.0;
    for (int a = 0; a < rows; ++a) sum += r[a] * r[a];
    return sum;
  };
  out.at.ends = here.ends();
  out.at.modes = -1;
  out.iterations = 1;
  double error2 = squared(out.at.ends);
  for (int chord = 0;; ++chord) {
    if (error2 <= tolerance * tolerance && norm(out.at.ends.moment) <= kBalance) break;
    if (chord > kChords) return false;
    for (int j = 0; j < n; ++j) {
      g[j] = 0.0;
      for (int a = 0; a < rows; ++a) g[j] += J[a][j] * r[a];
      low[j] = std::max(limits.lower[j] - p[j], -kTrustStart);
      high[j] = std::min(limits.upper[j] - p[j], kTrustStart);
    }
    box_step(n, H, g, low, high, d);
    for (int j = 0; j < n; ++j) p[j] = std::min(std::max(p[j] + d[j], limits.lower[j]), limits.upper[j]);
    out.at.modes = -1;
    if (chord == 0) {
      out.at.ends = ends_of(rod, p, moment, tip_force, 1.0, elements);
    } else {  // probably the last one: count unstable modes along
      judge(rod, p, moment, tip_force, 1.0, elements, out.at);
    }
    const double before = error2;
    error2 = squared(out.at.ends);
    if (!(error2 < 0.01 * before || error2 <= tolerance * tolerance)) return false;
  }
  if (out.at.modes < 0) judge(rod, p, moment, tip_force, 1.0, elements, out.at);
  out.moment = moment;
  out.statics = norm(out.at.ends.moment);
  out.residual = std::sqrt(error2);
  out.met = out.optimal = true;
  return true;
}

}  // namespace contid
