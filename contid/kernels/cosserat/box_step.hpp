// The bounded step of a descent: a small quadratic programme in a box.
// Twin and specification: contid/kinematics/cosserat/box_step.py.
#pragma once

#include "rod.hpp"

namespace contid {

// The Cholesky factor of the free rows and columns of a matrix, kept for another right-hand side.
struct FreeFactor {
  double L[kMost][kMost], inverse[kMost];  // of the diagonal
  int index[kMost], free = -1;
};

// Minimum of d H d / 2 + g d in a box that holds 0, of n unknowns, by a primal active set with Cholesky factors.
// `factor` belongs to H.
void box_step(int n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high, double* d,
              FreeFactor& factor);

inline void box_step(int n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high,
                     double* d) {
  FreeFactor factor;
  box_step(n, H, g, low, high, d, factor);
}

}  // namespace contid
