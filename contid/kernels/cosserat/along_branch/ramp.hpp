// The path from rest to a pose, kept for the poses next to it: whether a pose is on its branch is known once the path
// from rest has been followed (branch.hpp).
#pragma once

#include "../branch.hpp"

namespace contid {

// What following a path from rest costs at least, in the unit of `work` of searches: a step of a descent. The shortest
// path has as many points, at 0.25, 0.75 and 1 of the loads (kFirstStep doubles).
constexpr int kRampWork = 3;

// Equilibria on the path, before its end; the last ones are left out where there are too many.
struct Ramp {
  static constexpr int kMost = 24;  // equilibria; outside of Ramp kMost is the number of pressures
  double part[kMost];               // of pressures and loads that act there
  Vec moment[kMost];                // base moment
  Mat compliance[kMost];            // derivative of the base moment by the balance, `Judged::moment_by_balance`
  int count = 0, passed = 0;        // equilibria kept, and in all with that at the end
  double least = 1.0;               // least stiffness (branch.hpp) on the path

  int work() const { return kRampWork + passed; }
};

// Sum of the squares of the elements (boundary.hpp).
inline double squared(const Mat& a) {
  double sum = 0.0;
  for (const auto& row : a.m)
    for (double each : row) sum += each * each;
  return sum;
}

// `equilibrium` of a loaded rod that keeps the path: the part of pressures and loads reached, 1 for all of them.
inline double ramped(const Rod& rod, const double* pressures, Vec tip_force, int elements, Vec& moment, Judged& out,
                     Ramp& ramp) {
  const double none[kMost] = {};
  moment = {0, 0, 0};
  ramp.count = ramp.passed = 0, ramp.least = 1.0;
  return follow(rod, {none, {0, 0, 0}, 0.0}, {pressures, tip_force, 1.0}, elements, moment, out,
                [&](double part, Vec there) {
                  ++ramp.passed, ramp.least = std::fmin(ramp.least, stiffness(out));
                  if (part == 1.0 || ramp.count == Ramp::kMost) return;
                  ramp.part[ramp.count] = part, ramp.moment[ramp.count] = there;
                  ramp.compliance[ramp.count++] = out.moment_by_balance;
                });
}

}  // namespace contid
