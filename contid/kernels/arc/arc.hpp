// The arc of constant curvature: pose and coefficients without singularities, no allocation.
// The formulas are those of contid/kinematics/arc/arc.py, with their sources.
#pragma once

#include <cmath>
#include <cstring>

#include "../column.hpp"
#include "../series.hpp"

namespace contid {

// A = sin(t)/t, B = (1 - cos t)/t^2, C = (1 - A)/t^2, A1 = 2 dA/dq, B1 = 2 dB/dq, with q = t^2.
struct Coefficients {
  double A, B, C, A1, B1;
};

// Terms of their power series in q: of A, B, C and A1 in a column, and of B1.
struct CoefficientSeries {
  static constexpr int kTerms = 10;
  Column column[kTerms] = {};
  double B1[kTerms] = {};
  constexpr CoefficientSeries() {
    constexpr Series a(1), b(2), c(3), d(4);
    for (int k = 0; k < kTerms; ++k) {
      column[k] = Column{a.term[k], b.term[k], c.term[k], -2.0 * (k + 1) * c.term[k]};
      B1[k] = -2.0 * (k + 1) * d.term[k];
    }
  }
};

// For q of 0.5 and more; with the series below, the relative error at the switch is 1e-14.
[[gnu::noinline]] inline Coefficients closed_coefficients(double q) {
  Coefficients c;
  const double t = std::sqrt(q);
  const double half = std::sin(0.5 * t);
  c.A = std::sin(t) / t;
  c.B = 2.0 * half * half / q;
  c.C = (1.0 - c.A) / q;
  c.A1 = (std::cos(t) - c.A) / q;
  c.B1 = (c.A - 2.0 * c.B) / q;
  return c;
}

inline Coefficients coefficients(double q) {
  if (!(q < 0.5)) return closed_coefficients(q);
  static constexpr CoefficientSeries kSeries;
  constexpr int kLast = CoefficientSeries::kTerms - 1;
  Column sum = kSeries.column[kLast];
  double b1 = kSeries.B1[kLast];
  for (int k = kLast - 1; k >= 0; --k) {
    sum = sum * q + kSeries.column[k];
    b1 = b1 * q + kSeries.B1[k];
  }
  return {sum[0], sum[1], sum[2], sum[3], b1};
}

inline void arc_pose(const double* uvl, const Coefficients& c, double* p, double* r) {
  const double u = uvl[0], v = uvl[1], L = uvl[2];
  p[0] = L * u * c.B;
  p[1] = L * v * c.B;
  p[2] = L * c.A;
  r[0] = 1.0 - u * u * c.B;
  r[1] = r[3] = -u * v * c.B;
  r[4] = 1.0 - v * v * c.B;
  r[2] = u * c.A;
  r[5] = v * c.A;
  r[6] = -u * c.A;
  r[7] = -v * c.A;
  r[8] = 1.0 - (u * u + v * v) * c.B;
}

inline void product(const double* a, const double* b, double* out) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

inline void turn(const double* r, const double* x, double* out) {
  for (int i = 0; i < 3; ++i) out[i] = r[3 * i] * x[0] + r[3 * i + 1] * x[1] + r[3 * i + 2] * x[2];
}

inline void turn_back(const double* r, const double* x, double* out) {
  for (int i = 0; i < 3; ++i) out[i] = r[i] * x[0] + r[3 + i] * x[1] + r[6 + i] * x[2];
}

}  // namespace contid
