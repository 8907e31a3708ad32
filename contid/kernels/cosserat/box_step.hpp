// The bounded step of a descent: a small quadratic programme in a box,
//
//     minimise  1/2 d^T H d + g^T d   over  low <= d <= high,   H positive definite, 0 in the box,
//
// by a primal active set (Nocedal and Wright, Numerical Optimization, 2nd edition, section 16.5). It starts at d = 0
// and holds the bounds against which the gradient points. A Newton step of the free unknowns goes as far as the first
// bound, which is held too; where none is in the way, the held bound whose multiplier has the wrong sign most is
// released. It ends where no multiplier has, or after 4 n + 4 rounds.
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
