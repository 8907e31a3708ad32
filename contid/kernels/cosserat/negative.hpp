// Counts of unstable directions. Twin of contid/kinematics/cosserat/stability.py.
#pragma once

#include "spatial.hpp"

namespace contid {

// Negative roots of det(x - a) when all three are real: Descartes' count of sign changes is then exact.
inline int negative(const Mat& a) {
  const auto& m = a.m;
  const double c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1], c1 = m[1][0] * m[2][2] - m[1][2] * m[2][0],
               c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
  const double sign[3] = {m[0][0] + m[1][1] + m[2][2],
                          c0 + m[0][0] * m[2][2] - m[0][2] * m[2][0] + m[0][0] * m[1][1] - m[0][1] * m[1][0],
                          m[0][0] * c0 - m[0][1] * c1 + m[0][2] * c2};
  int changes = 0;
  bool last = true;
  for (double value : sign) {
    if (value == 0.0) continue;
    changes += (value > 0.0) != last;
    last = value > 0.0;
  }
  return changes;
}

}  // namespace contid
