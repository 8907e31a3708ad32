// Quaternions whose square is a tangent: r' = A i A*.
// extras/ropes/contid_ropes/ph/lift.py derives it.
#pragma once

#include <array>
#include <cmath>

namespace contid::ph {

using Vec = std::array<double, 3>;
using Quat = std::array<double, 4>;  // scalar, i, j, k

constexpr double pi = 3.14159265358979323846;
constexpr double no_turn = 1e-12;     // below this two unit quaternions have no preferred relative turn
constexpr double underflow = 1e-150;  // closer to -i than this the square underflows

inline double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double dot(const Quat& a, const Quat& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]; }

// <A, B> = (A i B* + B i A*) / 2; <A, A> is the hodograph
inline Vec product(const Quat& a, const Quat& b) {
  return {a[0] * b[0] + a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[3] + a[3] * b[0] + a[1] * b[2] + a[2] * b[1],
          a[1] * b[3] + a[3] * b[1] - a[0] * b[2] - a[2] * b[0]};
}

// A i: the preimage a quarter turn on, of the same vector
inline Quat times_i(const Quat& a) { return {-a[1], a[0], a[3], -a[2]}; }

// A (cos phi + i sin phi): another preimage of the same vector
inline Quat turned(const Quat& a, double cosine, double sine) {
  const Quat b = times_i(a);
  return {a[0] * cosine + b[0] * sine, a[1] * cosine + b[1] * sine, a[2] * cosine + b[2] * sine,
          a[3] * cosine + b[3] * sine};
}

// One A with A i A* = d: sqrt|d| (i + n) / |i + n|; at n = -i it is j
inline Quat lift(const Vec& d) {
  const double size = std::sqrt(dot(d, d));
  if (size == 0.0) return {0.0, 0.0, 0.0, 0.0};
  const double x = d[0] / size, y = d[1] / size, z = d[2] / size;
  const double off = std::hypot(y, z);
  if (x < 0.0 && off < underflow) return {0.0, 0.0, std::sqrt(size), 0.0};
  const double one_plus_x = x > 0.0 ? 1.0 + x : off * (off / (1.0 - x));
  const double scale = std::sqrt(size) / std::hypot(one_plus_x, off);
  return {0.0, scale * one_plus_x, scale * y, scale * z};
}

// B turned to be nearest to A: max A . B over phi; where every turn is equally near, <A, B> goes along `hint`
inline Quat nearest(const Quat& b, const Quat& a, const Vec& hint) {
  double cosine = dot(b, a), sine = dot(times_i(b), a);
  double size = std::hypot(cosine, sine);
  if (size <= no_turn * std::sqrt(dot(a, a) * dot(b, b))) {
    cosine = dot(product(a, b), hint);
    sine = dot(product(a, times_i(b)), hint);
    size = std::hypot(cosine, sine);
    if (size == 0.0) return b;
  }
  return turned(b, cosine / size, sine / size);
}

}  // namespace contid::ph
