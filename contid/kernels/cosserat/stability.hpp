// Stability of an equilibrium: the number of directions in which it is not a minimum of energy.
//
// With dead loads the energy is a functional of the rotation alone, fixed at the base and free at the tip. Its second
// variation leads to Jacobi's linear equation for (turn, change of moment). Cut at the element boundaries it is a
// block-tridiagonal quadratic form, and by Sylvester's law the negative eigenvalues of its 3x3 pivots add up to the
// number of unstable modes. With W_i the turns at boundary i of the three fields with a unit change of moment at the
// base, the pivot is local^-1 W_(i+1) W_i^-1. The response `local` of an element is positive definite if the element
// alone is stable, so the signs are those of the eigenvalues of W_(i+1) W_i^-1. The last pivot is the stiffness m W^-1
// at the tip. A negative sign marks a conjugate point, with its multiplicity; the sign of det(dM_tip/dM_0) misses the
// double roots of an axisymmetric rod.
//
// A dead moment does not derive from an energy in three dimensions: it enters the equilibrium only.
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
