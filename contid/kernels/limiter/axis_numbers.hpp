// Numbers of the axes of one robot.
#pragma once

namespace contid {

constexpr int kMostAxes = 256;

using AxisNumbers = double[kMostAxes];

struct Moving {
  AxisNumbers position, velocity, acceleration;  // [m, Pa or rad], 1/s and 1/s^2 of it
};

// Values below this share of the velocity limit are rounding, and rates are parallel within this share of their limits.
constexpr double kNegligible = 1e-9, kParallel = 1e-9;

}  // namespace contid
