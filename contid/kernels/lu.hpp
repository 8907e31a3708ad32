// Elimination with the greatest pivots, rows one after the other, without allocation.
#pragma once

#include <algorithm>
#include <cmath>

namespace contid {

// The factors of A in place, and which row was taken for each column; false: A is singular.
inline bool factorise_lu(double* a, int* order, int n) {
  for (int c = 0; c < n; ++c) {
    int best = c;
    for (int i = c + 1; i < n; ++i)
      if (std::fabs(a[i * n + c]) > std::fabs(a[best * n + c])) best = i;
    order[c] = best;
    if (!(std::fabs(a[best * n + c]) > 0.0)) return false;
    if (best != c) std::swap_ranges(a + c * n, a + (c + 1) * n, a + best * n);
    const double inverse = 1.0 / a[c * n + c];
    for (int i = c + 1; i < n; ++i) {
      const double factor = a[i * n + c] *= inverse;
      if (factor == 0.0) continue;
      for (int j = c + 1; j < n; ++j) a[i * n + j] -= factor * a[c * n + j];
    }
  }
  return true;
}

// X = A^-1 X, n x columns.
inline void solve_lu(const double* a, const int* order, int n, double* right, int columns) {
  for (int c = 0; c < n; ++c)
    if (order[c] != c) std::swap_ranges(right + c * columns, right + (c + 1) * columns, right + order[c] * columns);
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < i; ++k)
      for (int j = 0; j < columns; ++j) right[i * columns + j] -= a[i * n + k] * right[k * columns + j];
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k)
      for (int j = 0; j < columns; ++j) right[i * columns + j] -= a[i * n + k] * right[k * columns + j];
    for (int j = 0; j < columns; ++j) right[i * columns + j] /= a[i * n + i];
  }
}

}  // namespace contid
