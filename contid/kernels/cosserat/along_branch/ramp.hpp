// The path from rest to a pose, kept for the poses next to it: whether a pose is on its branch is known once the path
// from rest has been followed (branch.hpp).
#pragma once

#include "../branch.hpp"

namespace contid {

constexpr int kRampWork = 3;  // the least cost of following a path from rest, in steps of a descent

// Equilibria on the path, before its end; the last ones are left out where there are too many.
struct Ramp {
  static constexpr int kMost = 24;
  double part[kMost];
  Vec moment[kMost];
  Mat compliance[kMost];  // inverse of the balance by the base moment
  int count = 0, passed = 0;
  double least = 1.0;  // stiffness on the path

  int work() const { return kRampWork + passed; }
};

inline double squared(const Mat& a) {
  double sum = 0.0;
  for (const auto& row : a.m)
    for (double each : row) sum += each * each;
  return sum;
}

// `equilibrium` of a loaded rod that keeps the path.
inline double ramped(const Rod& rod, const double* pressures, Vec tip_force, int elements, Vec& moment, Judged& out,
                     Ramp& ramp) {
  const double none[kMost] = {};
  moment = {0, 0, 0};
  ramp.count = ramp.passed = 0, ramp.least = 1.0;
  return follow(rod, {none, {0, 0, 0}, 0.0}, {pressures, tip_force, 1.0}, elements, moment, out,
                [&](double part, Vec passed) {
                  ++ramp.passed, ramp.least = std::fmin(ramp.least, stiffness(out));
                  if (part == 1.0 || ramp.count == Ramp::kMost) return;
                  ramp.part[ramp.count] = part, ramp.moment[ramp.count] = passed;
                  ramp.compliance[ramp.count++] = out.moment_by_balance;
                });
}

}  // namespace contid
