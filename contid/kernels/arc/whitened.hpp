// A task in coordinates in which the metric W = F F^T of a step is the identity: K = J F^-T.
#pragma once

#include <type_traits>

#include "../column.hpp"
#include "cholesky.hpp"
#include "sections.hpp"

namespace contid::section_build {

constexpr int kMaxRows = 9;  // of a task: tip, direction, mid-point

// Calls work with the number of rows as a constant, which loops that long need to be fast.
template <class Work> inline void with_rows(int rows, const Work& work) {
  if (rows == 3)
    work(std::integral_constant<int, 3>());
  else if (rows == 6)
    work(std::integral_constant<int, 6>());
  else
    work(std::integral_constant<int, 9>());
}

// The lower Cholesky factor F of a metric.
struct Factor {
  const double* entries;  // row-major, kMaxLengths columns; null for the identity
  bool sections;          // true where W has nothing between two sections

  template <class T> void lower(int n, T* x) const {
    if (!entries) return;
    if (sections)
      solve_lower_blocks<kColumns>(entries, n, kMaxLengths, x);
    else
      solve_lower(entries, n, kMaxLengths, x);
  }
  void upper(int n, double* x) const {
    if (!entries) return;
    if (sections)
      solve_upper_blocks<kColumns>(entries, n, kMaxLengths, x);
    else
      solve_upper(entries, n, kMaxLengths, x);
  }
};

struct Whitened {
  Column columns[kMaxRows / 3][kMaxLengths];  // of K, three rows each; the spare numbers of the first are F^-1 z
  double gram[kMaxRows * kMaxRows];           // K K^T, the lower triangle
  double across[kMaxRows];                    // K F^-1 z

  double row(int a, int i) const { return columns[a / 3][i][a % 3]; }

  // Three rows of J, and z, are solved for at once.
  template <int Rows> void set(const Column (*J)[kMaxLengths], const double* z, const Factor& factor, int n) {
    for (int block = 0; block < Rows / 3; ++block) {
      for (int i = 0; i < n; ++i) {
        Column column = J[block][i];
        if (block == 0) column[3] = z[i];
        columns[block][i] = column;
      }
      factor.lower(n, columns[block]);
    }
    for (int b = 0; b < Rows; ++b)
      for (int block = 0; block <= b / 3; ++block) {
        Column sum{};
        for (int i = 0; i < n; ++i) sum += columns[block][i] * row(b, i);
        for (int a = 0; a < 3 && 3 * block + a <= b; ++a) gram[b * kMaxRows + 3 * block + a] = sum[a];
        if (block == 0) across[b] = sum[3];
      }
  }

  // F^-1 z + K^T y
  template <int Rows> void combine(const double* y, int n, double* out) const {
    for (int i = 0; i < n; ++i) {
      double sum = columns[0][i][3];
      for (int a = 0; a < Rows; ++a) sum += row(a, i) * y[a];
      out[i] = sum;
    }
  }
};

}  // namespace contid::section_build
