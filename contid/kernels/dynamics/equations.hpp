// Systems of equations without allocation; matrices have their rows one after the other.
#pragma once

#include <algorithm>
#include <cmath>

namespace contid {

// A symmetric matrix as L D L^T in place, L below the diagonal, D on it; false where a pivot is not positive.
inline bool factorise(double* a, int n) {
  for (int c = 0; c < n; ++c) {
    double* row = a + c * n;
    // Row c of L D, then of L; the upper triangle is left as it was.
    for (int k = 0; k < c; ++k) {
      const double* other = a + k * n;
      double sum = row[k];
      for (int j = 0; j < k; ++j) sum -= row[j] * other[j];
      row[k] = sum;
    }
    double pivot = row[c];
    for (int k = 0; k < c; ++k) {
      const double scaled = row[k] / a[k * n + k];
      pivot -= scaled * row[k];
      row[k] = scaled;
    }
    if (!(pivot > 0.0)) return false;
    row[c] = pivot;
  }
  return true;
}

inline void solve_factored(const double* a, int n, double* x) {
  for (int i = 0; i < n; ++i) {
    const double* row = a + i * n;
    double sum = x[i];
    for (int k = 0; k < i; ++k) sum -= row[k] * x[k];
    x[i] = sum;
  }
  for (int i = 0; i < n; ++i) x[i] /= a[i * n + i];
  for (int i = n - 1; i > 0; --i) {
    const double* row = a + i * n;
    for (int k = 0; k < i; ++k) x[k] -= row[k] * x[i];
  }
}

// x = A^-1 x for any A, by elimination with the greatest pivots; A is lost. False: it is singular.
inline bool solve_any(double* a, int n, double* x) {
  for (int c = 0; c < n; ++c) {
    int best = c;
    for (int i = c + 1; i < n; ++i)
      if (std::fabs(a[i * n + c]) > std::fabs(a[best * n + c])) best = i;
    if (!(std::fabs(a[best * n + c]) > 0.0)) return false;
    if (best != c) std::swap_ranges(a + c * n, a + (c + 1) * n, a + best * n), std::swap(x[c], x[best]);
    for (int i = c + 1; i < n; ++i) {
      const double share = a[i * n + c] / a[c * n + c];
      if (share == 0.0) continue;
      for (int j = c; j < n; ++j) a[i * n + j] -= share * a[c * n + j];
      x[i] -= share * x[c];
    }
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int j = i + 1; j < n; ++j) x[i] -= a[i * n + j] * x[j];
    x[i] /= a[i * n + i];
  }
  return true;
}

}  // namespace contid
