// The quintic with the preimage A(t) = A0 (1-t)^2 + 2 A1 t (1-t) + A2 t^2: points, length, energy.
// extras/ropes/contid_ropes/ph/quintic.py derives it.
#pragma once

#include "lift.hpp"

namespace contid::ph {

using Preimage = std::array<Quat, 3>;

struct Spinor {
  Quat a, d;     // A(t) and A'(t)
  double sigma;  // |A|^2
};

inline Spinor spinor(const Preimage& A, double t) {
  Spinor s;
  for (int i = 0; i < 4; ++i) {
    const double left = A[0][i] + (A[1][i] - A[0][i]) * t;
    const double right = A[1][i] + (A[2][i] - A[1][i]) * t;
    s.a[i] = left + (right - left) * t;
    s.d[i] = 2.0 * (right - left);
  }
  s.sigma = dot(s.a, s.a);
  return s;
}

// Angular rates of the Euler-Rodrigues frame (f1, f2, f3), f1 the tangent, per unit of t, each times sigma / 2:
// f2' . f3, f1' . f2 and f1' . f3.
struct Rates {
  double spin, k2, k3;
};

inline Rates rates(const Spinor& s) {
  const auto& [u, v, p, q] = s.a;  // A = u + v i + p j + q k
  const auto& [du, dv, dp, dq] = s.d;
  return {u * dv - du * v - p * dq + dp * q, u * dq - du * q - v * dp + dv * p, -(u * dp - du * p + v * dq - dv * q)};
}

// Bernstein coefficients of the parametric speed sigma = |A|^2 [m].
inline std::array<double, 5> speed_coefficients(const Preimage& A) {
  return {dot(A[0], A[0]), dot(A[0], A[1]), (dot(A[0], A[2]) + 2.0 * dot(A[1], A[1])) / 3.0, dot(A[1], A[2]),
          dot(A[2], A[2])};
}

// S = int sigma dt, the mean of the coefficients of sigma [m].
inline double length_of(const Preimage& A) {
  const std::array<double, 5> sigma = speed_coefficients(A);
  return (sigma[0] + sigma[1] + sigma[2] + sigma[3] + sigma[4]) / 5.0;
}

// Parameter at arc length s: Newton on the quintic, kept inside a bracket that only shrinks.
inline double parameter_at(const Preimage& A, double length, double s) {
  const std::array<double, 5> sigma = speed_coefficients(A);
  if (!(s > 0.0)) return 0.0;
  if (s >= length) return 1.0;
  double low = 0.0, high = 1.0, t = s / length;
  for (int iteration = 0; iteration < 60; ++iteration) {
    // The arc length at t by de Casteljau's rule: its coefficients are sums of those of sigma, divided by five.
    std::array<double, 6> b;
    b[0] = 0.0;
    for (int i = 0; i < 5; ++i) b[i + 1] = b[i] + sigma[i] / 5.0;
    for (int level = 5; level > 0; --level)
      for (int i = 0; i < level; ++i) b[i] += (b[i + 1] - b[i]) * t;
    const double excess = b[0] - s;
    if (excess == 0.0) return t;
    (excess < 0.0 ? low : high) = t;
    const double speed = spinor(A, t).sigma;
    double next = speed > 0.0 ? t - excess / speed : -1.0;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    if (std::fabs(next - t) <= 1e-15) return next;
    t = next;
  }
  return t;
}

// The point of least z among `samples` points of a curve at equal steps of t, from its start. The control points P
// integrate the hodograph exactly: each is the one before plus a Bernstein coefficient of the hodograph, divided by
// five. The middle coefficient is (s2 + 2 s3) / 3, so that 15 divides it.
inline Vec lowest(const Preimage& A, int samples) {
  const Vec s0 = product(A[0], A[0]), s1 = product(A[0], A[1]), s2 = product(A[0], A[2]), s3 = product(A[1], A[1]),
            s4 = product(A[1], A[2]), s5 = product(A[2], A[2]);
  Vec P[6] = {{0.0, 0.0, 0.0}};
  for (int i = 0; i < 3; ++i) {
    const double step[5] = {s0[i] / 5.0, s1[i] / 5.0, (s2[i] + 2.0 * s3[i]) / 15.0, s4[i] / 5.0, s5[i] / 5.0};
    for (int k = 0; k < 5; ++k) P[k + 1][i] = P[k][i] + step[k];
  }
  Vec best = P[0];
  for (int sample = 1; sample < samples; ++sample) {
    const double t = static_cast<double>(sample) / (samples - 1);
    Vec Q[6];  // de Casteljau's rule
    for (int k = 0; k < 6; ++k) Q[k] = P[k];
    for (int level = 5; level > 0; --level)
      for (int k = 0; k < level; ++k)
        for (int i = 0; i < 3; ++i) Q[k][i] += (Q[k + 1][i] - Q[k][i]) * t;
    if (Q[0][2] < best[2]) best = Q[0];
  }
  return best;
}

// 24-point Gauss rule on [0, 1], by Newton on the Legendre polynomial.
struct Gauss {
  static constexpr int count = 24;
  double node[count], weight[count];
  Gauss() {
    for (int i = 0; i < count; ++i) {
      double x = std::cos(pi * (i + 0.75) / (count + 0.5)), slope = 1.0;
      for (int step = 0; step < 20; ++step) {
        double before = 1.0, here = x;
        for (int n = 2; n <= count; ++n) {
          const double next = ((2 * n - 1) * x * here - (n - 1) * before) / n;
          before = here;
          here = next;
        }
        slope = count * (before - x * here) / (1.0 - x * x);
        x -= here / slope;
      }
      node[i] = 0.5 * (1.0 - x);
      weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);  // half of that on [-1, 1]
    }
  }
};

// int (w1^2 + w2^2 + w3^2) / sigma dt with the angular rates w per unit of t: bending plus twisting energy for unit
// stiffness [1/m]. `rates` has them times sigma / 2, hence 4 / sigma^2.
inline double energy(const Preimage& A) {
  static const Gauss gauss;
  double sum = 0.0;
  for (int i = 0; i < Gauss::count; ++i) {
    const Spinor s = spinor(A, gauss.node[i]);
    const auto [spin, k2, k3] = rates(s);
    sum += gauss.weight[i] * 4.0 * (spin * spin + k2 * k2 + k3 * k3) / (s.sigma * s.sigma * s.sigma);
  }
  return sum;
}

}  // namespace contid::ph
