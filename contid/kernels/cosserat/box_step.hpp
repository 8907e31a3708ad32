// The bounded step of a descent: a small quadratic programme in a box,
//
//     minimise  1/2 d^T H d + g^T d   over  low <= d <= high,   H positive definite, 0 in the box,
//
// by a primal active set (Nocedal and Wright, Numerical Optimization, 2nd edition, section 16.5). It starts at d = 0
// and holds the bounds against which the gradient points. A Newton step of the free unknowns goes as far as the first
// bound, which is held too; where none is in the way, the held bound whose multiplier has the wrong sign most is
// released. It ends where no multiplier has, at the minimum, or after 4 n + 4 rounds, at a step that is feasible but
// perhaps not the best.
#pragma once

#include "rod.hpp"

namespace contid {

// The Cholesky factor L L^T of the rows and columns of H whose unknowns are not held, kept for another right-hand side
// with the same H. It does not notice another H: begin with a new one then.
struct FreeFactor {
  double L[kMost][kMost];
  double inverse[kMost];  // 1 / L[i][i]
  int index[kMost];       // the free unknowns, in the order of the rows of L
  int free = -1;          // their number; -1: nothing is factorised yet
};

// The step d of n unknowns that minimises 1/2 d^T H d + g^T d in the box; `factor` is new, or that of the same H.
void box_step(int n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high, double* d,
              FreeFactor& factor);

inline void box_step(int n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high,
                     double* d) {
  FreeFactor factor;
  box_step(n, H, g, low, high, d, factor);
}

}  // namespace contid
