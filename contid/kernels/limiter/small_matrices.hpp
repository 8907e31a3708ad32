// Pseudo-inverses and bounded least squares of matrices of a few rows and columns, without allocations.
#pragma once

#include <algorithm>
#include <cmath>

#include "../arc/cholesky.hpp"

namespace contid {

constexpr int kMostColumns = 64;
// A row for the preferred value of each column, and 16 for the coordinates of a target and their progress (chord.hpp).
constexpr int kMostRows = kMostColumns + 16;

// Columns of a matrix, one after the other.
struct SmallMatrix {
  int rows, columns;
  double of[kMostColumns][kMostRows];
};

// Rotates two vectors, a' = c a - s b and b' = s a + c b.
inline void rotate(double* a, double* b, int count, double c, double s) {
  for (int i = 0; i < count; ++i) {
    const double x = a[i], y = b[i];
    a[i] = c * x - s * y, b[i] = s * x + c * y;
  }
}

// The Moore-Penrose inverse: singular values of at most `singular` times the greatest count as none. One-sided Jacobi
// rotations make the columns orthogonal, A V = U S, and A+ = V S^-1 U^T (M. R. Hestenes, "Inversion of matrices by
// biorthogonalization and related results", 1958). A, of m rows and n columns, is overwritten; it has at least as many
// rows as columns. Element (i, k) of A+, i < n and k < m, goes to out[i * m + k]. `wide`: A is the transpose of the
// matrix whose inverse is asked for; that is the transpose of A+, and (i, k) goes to out[k * n + i].
inline void pseudo_inverse(SmallMatrix& a, bool wide, double singular, double* out) {
  constexpr int kSweeps = 60;
  constexpr double kOrthogonal = 1e-16;
  const int m = a.rows, n = a.columns;
  double v[kMostColumns][kMostColumns] = {}, squares[kMostColumns];
  for (int j = 0; j < n; ++j) v[j][j] = 1.0;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    bool turned = false;
    for (int p = 0; p < n; ++p)
      for (int q = p + 1; q < n; ++q) {
        const double pp = dot(a.of[p], a.of[p], m), qq = dot(a.of[q], a.of[q], m), pq = dot(a.of[p], a.of[q], m);
        if (!(std::fabs(pq) > kOrthogonal * std::sqrt(pp * qq))) continue;
        const double zeta = (qq - pp) / (2.0 * pq);
        const double t = std::copysign(1.0, zeta) / (std::fabs(zeta) + std::sqrt(1.0 + zeta * zeta));
        const double c = 1.0 / std::sqrt(1.0 + t * t), s = c * t;
        rotate(a.of[p], a.of[q], m, c, s), rotate(v[p], v[q], n, c, s);
        turned = turned || std::fabs(t) > kOrthogonal;
      }
    if (!turned) break;
  }
  double most = 0.0;
  for (int j = 0; j < n; ++j) most = std::max(most, squares[j] = dot(a.of[j], a.of[j], m));
  std::fill_n(out, m * n, 0.0);
  for (int j = 0; j < n; ++j) {
    if (!(squares[j] > singular * singular * most)) continue;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < m; ++k) out[wide ? k * n + i : i * m + k] += v[j][i] * a.of[j][k] / squares[j];
  }
}

// x of the least |A x - b|, by Householder reflections; A and b are overwritten. A has at least as many rows as
// columns. A column that depends on those before it gets 0, where what is left of it is exactly 0: a small rest by
// rounding counts as independent. The rows of preferred steps in chord.hpp make all columns independent.
inline void least_squares(SmallMatrix& a, double* b, double* x) {
  const int m = a.rows, n = a.columns;
  double diagonal[kMostColumns];
  for (int j = 0; j < n; ++j) {
    double* column = a.of[j];
    const double size = std::sqrt(dot(column + j, column + j, m - j));
    diagonal[j] = column[j] > 0.0 ? -size : size;
    if (size == 0.0) continue;
    column[j] -= diagonal[j];  // the reflection's normal, of the square 2 size (size + |a_jj|)
    const double per_square = 2.0 / dot(column + j, column + j, m - j);
    const auto reflect = [&](double* to) {
      const double share = per_square * dot(column + j, to + j, m - j);
      for (int i = j; i < m; ++i) to[i] -= share * column[i];
    };
    for (int k = j + 1; k < n; ++k) reflect(a.of[k]);
    reflect(b);
  }
  for (int j = n - 1; j >= 0; --j) {
    double value = b[j];
    for (int k = j + 1; k < n; ++k) value -= a.of[k][j] * x[k];
    x[j] = diagonal[j] != 0.0 ? value / diagonal[j] : 0.0;
  }
}

// Minimum of |A x - b| with low <= x <= high, by a primal active set. `held` are the bounds that hold (-1, 0, 1): those
// of a similar problem before, those of this one after. After 4 n rounds the x found so far stays; it keeps the bounds.
inline void bounded_least_squares(const SmallMatrix& a, const double* b, const double* low, const double* high,
                                  signed char* held, double* x) {
  // A bound is released where |A x - b|^2 / 2 falls by more than this, times the greatest number of b, per unit of x
  // away from it. Less is rounding.
  constexpr double kReleases = 1e-14;
  const int m = a.rows, n = a.columns;
  double most = 0.0;
  for (int i = 0; i < m; ++i) most = std::max(most, std::fabs(b[i]));
  for (int j = 0; j < n; ++j)
    x[j] = held[j] < 0 ? low[j] : held[j] > 0 ? high[j] : std::min(std::max(0.0, low[j]), high[j]);
  for (int round = 0; round < 4 * n; ++round) {
    SmallMatrix free;
    double right[kMostRows], y[kMostColumns];
    int numbers[kMostColumns];
    free.rows = m, free.columns = 0;
    std::copy_n(b, m, right);
    for (int j = 0; j < n; ++j) {
      if (held[j] == 0) {
        std::copy_n(a.of[j], m, free.of[free.columns]);
        numbers[free.columns++] = j;
      } else {
        for (int i = 0; i < m; ++i) right[i] -= a.of[j][i] * x[j];
      }
    }
    if (free.columns) {
      least_squares(free, right, y);
      double share = 1.0;
      int stop = -1;
      for (int k = 0; k < free.columns; ++k) {
        const int j = numbers[k];
        if (!(y[k] < low[j] || y[k] > high[j])) continue;
        const double end = y[k] < low[j] ? low[j] : high[j];
        const double part = y[k] != x[j] ? (end - x[j]) / (y[k] - x[j]) : 0.0;
        if (part < share) share = part, stop = k;
      }
      for (int k = 0; k < free.columns; ++k) x[numbers[k]] += share * (y[k] - x[numbers[k]]);
      if (stop >= 0) {
        const int j = numbers[stop];
        held[j] = y[stop] < low[j] ? -1 : 1;
        x[j] = held[j] < 0 ? low[j] : high[j];
        continue;
      }
    }
    double missed[kMostRows];
    for (int i = 0; i < m; ++i) missed[i] = -b[i];
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < m; ++i) missed[i] += a.of[j][i] * x[j];
    int worst = 0;
    double steepest = 0.0;
    for (int j = 0; j < n; ++j) {
      const double slope = dot(a.of[j], missed, m) * held[j];
      if (slope > steepest) steepest = slope, worst = j;
    }
    if (!(steepest > kReleases * most)) return;
    held[worst] = 0;
  }
}

}  // namespace contid
