// Vectors, 3x3 matrices and the exponential of a screw; contid/kinematics/cosserat/element.py has the formulas. C++17,
// no allocation, no exceptions, no dependence on libm where a series will do (the same digits on every machine).
#pragma once

#include <cmath>

#include "../series.hpp"

namespace contid {

struct Vec {
  double x, y, z;
};

inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator*(double s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double norm(Vec a) { return std::sqrt(dot(a, a)); }

struct Mat {
  double m[3][3];
};

inline Mat identity() { return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}; }
inline Vec column(const Mat& a, int j) { return {a.m[0][j], a.m[1][j], a.m[2][j]}; }
inline Vec operator*(const Mat& a, Vec v) {
  return {a.m[0][0] * v.x + a.m[0][1] * v.y + a.m[0][2] * v.z, a.m[1][0] * v.x + a.m[1][1] * v.y + a.m[1][2] * v.z,
          a.m[2][0] * v.x + a.m[2][1] * v.y + a.m[2][2] * v.z};
}
inline Vec transposed_times(const Mat& a, Vec v) {
  return {a.m[0][0] * v.x + a.m[1][0] * v.y + a.m[2][0] * v.z, a.m[0][1] * v.x + a.m[1][1] * v.y + a.m[2][1] * v.z,
          a.m[0][2] * v.x + a.m[1][2] * v.y + a.m[2][2] * v.z};
}
[[gnu::always_inline]] inline Mat operator*(const Mat& a, const Mat& b) {
  Mat c;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) c.m[i][j] = a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j];
  return c;
}

inline double determinant(const Mat& a) {
  const auto& m = a.m;
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) + m[0][1] * (m[1][2] * m[2][0] - m[1][0] * m[2][2]) +
         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

// Inverse by cofactors; false for a singular matrix, of a determinant of at most 1e-300.
inline bool inverse(const Mat& a, Mat& out) {
  const auto& m = a.m;
  const double c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1], c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2],
               c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
  const double det = m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2;
  if (!(std::fabs(det) > 1e-300)) return false;
  const double d = 1.0 / det;
  out = {{{d * c0, d * (m[0][2] * m[2][1] - m[0][1] * m[2][2]), d * (m[0][1] * m[1][2] - m[0][2] * m[1][1])},
          {d * c1, d * (m[0][0] * m[2][2] - m[0][2] * m[2][0]), d * (m[0][2] * m[1][0] - m[0][0] * m[1][2])},
          {d * c2, d * (m[0][1] * m[2][0] - m[0][0] * m[2][1]), d * (m[0][0] * m[1][1] - m[0][1] * m[1][0])}}};
  return true;
}

// The matrix of a cross product: hat(a) b = a x b.
inline Mat hat(Vec a) { return {{{0, -a.z, a.y}, {a.z, 0, -a.x}, {-a.y, a.x, 0}}}; }

// (1 - cos t)/t^2 and (t - sin t)/t^3 in powers of t^2; the remainder is below 1e-18 for t < 1.
constexpr Series kVersine(2), kShift(3);

// The first nine terms by Estrin's scheme: its chain of dependent operations is half of Horner's.
[[gnu::always_inline]] inline double evaluate(const Series& series, double x) {
  const double (&a)[10] = series.term;
  const double x2 = x * x, x4 = x2 * x2;
  const double low = (a[0] + a[1] * x) + (a[2] + a[3] * x) * x2;
  const double high = (a[4] + a[5] * x) + (a[6] + a[7] * x) * x2;
  return low + (high + a[8] * x4) * x4;
}

// exp of the screw (u, v), a turn by |u| about u with the shift v per unit of it: rotation and shift. With t = |u| the
// rotation is cos t + sin t / t [u] + (1 - cos t) / t^2 u u^T (Rodrigues); the shift is v + (1 - cos t) / t^2 u x v +
// (t - sin t) / t^3 u x (u x v).
[[gnu::always_inline]] inline void screw(Vec u, Vec v, Mat& rotation, Vec& shift) {
  const double t2 = dot(u, u);
  double b, c;
  if (t2 < 1.0) {
    b = evaluate(kVersine, t2);
    c = evaluate(kShift, t2);
  } else {
    const double t = std::sqrt(t2);
    b = (1.0 - std::cos(t)) / t2;
    c = (1.0 - std::sin(t) / t) / t2;
  }
  const double a = 1.0 - t2 * c;
  const double d = 1.0 - b * t2;  // cos t
  rotation = {{{d + b * u.x * u.x, b * u.x * u.y - a * u.z, b * u.x * u.z + a * u.y},
               {b * u.y * u.x + a * u.z, d + b * u.y * u.y, b * u.y * u.z - a * u.x},
               {b * u.z * u.x - a * u.y, b * u.z * u.y + a * u.x, d + b * u.z * u.z}}};
  const Vec uv = cross(u, v);
  shift = v + b * uv + c * cross(u, uv);
}

}  // namespace contid
