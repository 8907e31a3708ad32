// Coefficients of the Taylor series of sines and cosines.
#pragma once

namespace contid {

// (-1)^k / (2 k + offset)! for k = 0..9; factorials up to 22! are exact.
struct Series {
  double term[10] = {};
  explicit constexpr Series(int offset) {
    double factorial = offset == 4 ? 24.0 : offset == 3 ? 6.0 : offset;
    for (int k = 0; k < 10; ++k) {
      term[k] = (k % 2 == 0 ? 1.0 : -1.0) / factorial;
      factorial *= (2 * k + offset + 1) * (2 * k + offset + 2);
    }
  }
};

}  // namespace contid
