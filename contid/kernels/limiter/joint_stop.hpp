// The stop of all axes of a robot that ends at the same time.
//
// Axes whose velocities and accelerations are parallel stay on their straight line, by motion rules above 1: theirs are
// shares of one stop, with the greatest acceleration and jerk that all of them allow.
#pragma once

#include <vector>

#include "axis_numbers.hpp"
#include "stop.hpp"

namespace contid {

// Share of the jerk that a stop uses: the pursuit that leads into it (contid/kernels/motion/pursuit.cpp) uses no more.
constexpr double kJerkShare = 1.0 - 1e-6;

// Axis k goes shares[k] times the way of stops[k], in units of its greatest velocity.
struct JointStop {
  AxisNumbers shares;
  std::vector<AxisStop> stops;
  double duration_s = 0.0;
  bool line = false;
};

inline JointStop joint_stop(const Moving& at, const std::vector<double>& velocity,
                            const std::vector<double>& acceleration, const std::vector<double>& jerk, bool keeps_line) {
  const int axes = static_cast<int>(velocity.size());
  // In units of the greatest velocities.
  AxisNumbers v = {}, a = {}, most = {}, jolts = {};
  int lead = 0;  // the fastest axis
  const auto rounded = [](double value) { return std::fabs(value) < kNegligible ? 0.0 : value; };
  for (int k = 0; k < axes; ++k) {
    v[k] = rounded(at.velocity[k] / velocity[k]), a[k] = rounded(at.acceleration[k] / velocity[k]);
    most[k] = acceleration[k] / velocity[k], jolts[k] = kJerkShare * (jerk[k] / velocity[k]);
    if (std::fabs(v[k]) > std::fabs(v[lead])) lead = k;
  }
  JointStop joint;
  joint.stops.resize(axes);
  bool on_line = keeps_line && v[lead] != 0.0;
  for (int k = 0; on_line && k < axes; ++k) {
    const double share = joint.shares[k] = v[k] / v[lead];
    on_line =
        std::fabs(v[k] - share * v[lead]) <= kParallel && std::fabs(a[k] - share * a[lead]) <= kParallel * most[k];
  }
  if (on_line) {
    joint.line = true;
    double greatest = most[lead], jolt = jolts[lead];
    for (int k = 0; k < axes; ++k) {
      if (joint.shares[k] == 0.0) continue;
      greatest = std::min(greatest, most[k] / std::fabs(joint.shares[k]));
      jolt = std::min(jolt, jolts[k] / std::fabs(joint.shares[k]));
    }
    std::fill_n(joint.stops.begin(), axes, shortest_stop(v[lead], a[lead], greatest, jolt));
    joint.duration_s = joint.stops[0].duration_s();
    return joint;
  }
  std::fill_n(joint.shares, axes, 1.0);
  for (int k = 0; k < axes; ++k) {
    joint.stops[k] = shortest_stop(v[k], a[k], most[k], jolts[k]);
    joint.duration_s = std::max(joint.duration_s, joint.stops[k].duration_s());
  }
  for (int k = 0; k < axes; ++k)
    if (joint.stops[k].duration_s() < joint.duration_s)
      joint.stops[k] = stop_in(v[k], a[k], jolts[k], joint.duration_s);
  return joint;
}

}  // namespace contid
