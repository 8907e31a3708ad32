// The arc of constant curvature: pose and coefficients without singularities, no allocation.
// Twin and specification: contid/kinematics/arc/arc.py (same names, same formulas).
#pragma once

#include <cmath>
#include <cstring>

#include "../series.hpp"

namespace contid {

// A = sin(t)/t, B = (1 - cos t)/t^2, C = (1 - A)/t^2, A1 = 2 dA/dq, B1 = 2 dB/dq, with q = t^2.
struct Coefficients {
  double A, B, C, A1, B1;
};

inline Coefficients coefficients(double q) {
  Coefficients c;
  if (q < 0.5) {
    // Relative error 1e-14 at the switch.
    static constexpr Series kA(1), kB(2), kC(3), kD(4);
    double a = 0.0, b = 0.0, d = 0.0, a1 = 0.0, b1 = 0.0;
    for (int k = 9; k >= 0; --k) {
      a = a * q + kA.term[k];
      b = b * q + kB.term[k];
      d = d * q + kC.term[k];
      a1 = a1 * q - 2.0 * (k + 1) * kC.term[k];
      b1 = b1 * q - 2.0 * (k + 1) * kD.term[k];
    }
    c = {a, b, d, a1, b1};
  } else {
    const double t = std::sqrt(q);
    const double half = std::sin(0.5 * t);
    c.A = std::sin(t) / t;
    c.B = 2.0 * half * half / q;
    c.C = (1.0 - c.A) / q;
    c.A1 = (std::cos(t) - c.A) / q;
    c.B1 = (c.A - 2.0 * c.B) / q;
  }
  return c;
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
