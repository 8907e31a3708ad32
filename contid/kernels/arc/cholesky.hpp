// Cholesky factors of small matrices, row-major with `stride` columns, in place.
//
// Always inlined: with the sizes of the caller all numbers stay in registers. A step waits for these roots and
// quotients half of its time, and would wait for memory too.
#pragma once

#include <cmath>

namespace contid {

inline double dot(const double* a, const double* b, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

// A = F F^T: the lower triangle of A becomes F; false when A is not positive definite.
[[gnu::always_inline]] inline bool factor(double* a, int n, int stride) {
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

// x = F^-1 x, for numbers or for columns of numbers at once
template <class T> [[gnu::always_inline]] inline void solve_lower(const double* f, int n, int stride, T* x) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= f[i * stride + k] * x[k];
    x[i] /= f[i * stride + i];
  }
}

// x = F^-T x
[[gnu::always_inline]] inline void solve_upper(const double* f, int n, int stride, double* x) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= f[k * stride + i] * x[k];
    x[i] /= f[i * stride + i];
  }
}

// The same for a factor that is zero outside blocks of `Block` rows on its diagonal.
template <int Block, class T>
[[gnu::always_inline]] inline void solve_lower_blocks(const double* f, int n, int stride, T* x) {
  for (int i = 0; i < n; i += Block) solve_lower(f + i * (stride + 1), Block, stride, x + i);
}
template <int Block>
[[gnu::always_inline]] inline void solve_upper_blocks(const double* f, int n, int stride, double* x) {
  for (int i = 0; i < n; i += Block) solve_upper(f + i * (stride + 1), Block, stride, x + i);
}

// A = U^T U for matrices of dozens of rows, n x n and symmetric: the upper triangle of A becomes U. The numbers of
// factor(), to the bit, row after row: a row does not wait for its own sums.
inline bool factor_rows(double* a, int n) {
  for (int k = 0; k < n; ++k) {
    double* row = a + k * n;
    if (!(row[k] > 0.0)) return false;
    row[k] = std::sqrt(row[k]);
    const double inverse = 1.0 / row[k];
    for (int j = k + 1; j < n; ++j) row[j] *= inverse;
    for (int i = k + 1; i < n; ++i) {
      double* below = a + i * n;
      const double part = row[i];
      for (int j = i; j < n; ++j) below[j] -= part * row[j];
    }
  }
  return true;
}

// x = (U^T U)^-1 x
inline void solve_rows(const double* u, int n, double* x) {
  for (int i = 0; i < n; ++i) {
    const double* row = u + i * n;
    const double value = x[i] /= row[i];
    for (int j = i + 1; j < n; ++j) x[j] -= row[j] * value;
  }
  for (int i = n - 1; i >= 0; --i) {
    const double* row = u + i * n;
    double value = x[i];
    for (int k = i + 1; k < n; ++k) value -= row[k] * x[k];
    x[i] = value / row[i];
  }
}

}  // namespace contid
