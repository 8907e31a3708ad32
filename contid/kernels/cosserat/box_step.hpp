// The bounded step of a descent: a small quadratic programme in a box.
// Twin and specification: contid/kinematics/cosserat/box_step.py.
#pragma once

#include <algorithm>
#include <cmath>

namespace contid {

// The Cholesky factor of the free rows and columns of a matrix, kept for another right-hand side.
template <int n> struct FreeFactor {
  double L[n][n], inverse[n];  // of the diagonal
  int index[n], free = -1;

  void of(const double (&H)[n][n], const int* rows, int count) {
    if (count == free && std::equal(rows, rows + count, index)) return;
    free = count;
    std::copy(rows, rows + count, index);
    for (int a = 0; a < free; ++a) {
      double diagonal = H[index[a]][index[a]];
      for (int k = 0; k < a; ++k) diagonal -= L[a][k] * L[a][k];
      L[a][a] = std::sqrt(std::fmax(diagonal, 1e-30));
      inverse[a] = 1.0 / L[a][a];
      for (int b = a + 1; b < free; ++b) {
        double value = H[index[b]][index[a]];
        for (int k = 0; k < a; ++k) value -= L[b][k] * L[a][k];
        L[b][a] = value * inverse[a];
      }
    }
  }

  void solve(double* x) const {
    for (int a = 0; a < free; ++a) {
      for (int k = 0; k < a; ++k) x[a] -= L[a][k] * x[k];
      x[a] *= inverse[a];
    }
    for (int a = free - 1; a >= 0; --a) {
      for (int k = a + 1; k < free; ++k) x[a] -= L[k][a] * x[k];
      x[a] *= inverse[a];
    }
  }
};

// Minimum of d H d / 2 + g d in a box that holds 0, by a primal active set with Cholesky factors. `factor` belongs to
// H.
template <int n>
void box_step(const double (&H)[n][n], const double* g, const double* low, const double* high, double* d,
              FreeFactor<n>& factor) {
  bool held[n];
  double largest = 0.0;
  for (int i = 0; i < n; ++i) {
    d[i] = 0.0;
    held[i] = (low[i] >= 0.0 && g[i] > 0.0) || (high[i] <= 0.0 && g[i] < 0.0);
    largest = std::fmax(largest, std::fabs(g[i]));
  }
  for (int round = 0; round < 4 * n + 4; ++round) {
    int index[n], free = 0;
    for (int i = 0; i < n; ++i)
      if (!held[i]) index[free++] = i;
    if (free > 0) {
      double x[n];
      for (int a = 0; a < free; ++a) {
        double slope = g[index[a]];
        for (int j = 0; j < n; ++j) slope += H[index[a]][j] * d[j];
        x[a] = -slope;
      }
      factor.of(H, index, free);
      factor.solve(x);
      double fraction = 1.0;
      int blocking = -1;
      for (int a = 0; a < free; ++a) {
        const int i = index[a];
        if (x[a] == 0.0) continue;
        const double room = ((x[a] > 0.0 ? high[i] : low[i]) - d[i]) / x[a];
        if (room < fraction) fraction = room, blocking = a;
      }
      for (int a = 0; a < free; ++a) d[index[a]] += fraction * x[a];
      if (blocking >= 0) {
        const int i = index[blocking];
        d[i] = x[blocking] > 0.0 ? high[i] : low[i];
        held[i] = true;
        continue;
      }
    }
    int worst = -1;
    double most = 1e-12 * (1.0 + largest);
    for (int i = 0; i < n; ++i) {
      if (!held[i]) continue;
      double pull = g[i];
      for (int j = 0; j < n; ++j) pull += H[i][j] * d[j];
      const double wrong = d[i] <= low[i] ? -pull : pull;
      if (wrong > most) most = wrong, worst = i;
    }
    if (worst < 0) break;
    held[worst] = false;
  }
  for (int i = 0; i < n; ++i) d[i] = std::min(std::max(d[i], low[i]), high[i]);
}

template <int n>
void box_step(const double (&H)[n][n], const double* g, const double* low, const double* high, double* d) {
  FreeFactor<n> factor;
  box_step<n>(H, g, low, high, d, factor);
}

}  // namespace contid
