// Cholesky factors of small matrices, row-major with `stride` columns, in place.
#pragma once

#include <cmath>

namespace contid {

inline double dot(const double* a, const double* b, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

// A = F F^T: the lower triangle of A becomes F; false when A is not positive definite.
inline bool factor(double* a, int n, int stride) {
  for (int j = 0; j < n; ++j) {
    double* row_j = a + j * stride;
    double pivot = row_j[j];
    for (int k = 0; k < j; ++k) pivot -= row_j[k] * row_j[k];
    if (!(pivot > 0.0)) return false;
    row_j[j] = std::sqrt(pivot);
    const double inverse = 1.0 / row_j[j];
    for (int i = j + 1; i < n; ++i) {
      double* row_i = a + i * stride;
      double value = row_i[j];
      for (int k = 0; k < j; ++k) value -= row_i[k] * row_j[k];
      row_i[j] = value * inverse;
    }
  }
  return true;
}

// x = F^-1 x
inline void solve_lower(const double* f, int n, int stride, double* x) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= f[i * stride + k] * x[k];
    x[i] /= f[i * stride + i];
  }
}

// x = F^-T x
inline void solve_upper(const double* f, int n, int stride, double* x) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= f[k * stride + i] * x[k];
    x[i] /= f[i * stride + i];
  }
}

}  // namespace contid
