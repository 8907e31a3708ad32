// One element of constant strain (bends u, v, twist, stretch): its end, turn, the twists of its coordinates and their
// derivatives.
#pragma once

#include "../cosserat/spatial.hpp"

namespace contid {

constexpr int kMaxTendons = 64;

inline Mat product_of(Vec a, Vec b) {
  return {{{a.x * b.x, a.x * b.y, a.x * b.z}, {a.y * b.x, a.y * b.y, a.y * b.z}, {a.z * b.x, a.z * b.y, a.z * b.z}}};
}

inline void add(Mat& a, const Mat& b) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a.m[i][j] += b.m[i][j];
}

// A number with its derivatives by the four coordinates.
struct Slope4 {
  double v = 0.0, d[4] = {};
  Slope4() = default;
  Slope4(double value) : v(value) {}
};

inline Slope4 operator+(const Slope4& a, const Slope4& b) {
  Slope4 out(a.v + b.v);
  for (int k = 0; k < 4; ++k) out.d[k] = a.d[k] + b.d[k];
  return out;
}
inline Slope4 operator-(const Slope4& a, const Slope4& b) {
  Slope4 out(a.v - b.v);
  for (int k = 0; k < 4; ++k) out.d[k] = a.d[k] - b.d[k];
  return out;
}
inline Slope4 operator*(const Slope4& a, const Slope4& b) {
  Slope4 out(a.v * b.v);
  for (int k = 0; k < 4; ++k) out.d[k] = a.d[k] * b.v + a.v * b.d[k];
  return out;
}

struct Vec4 {
  Slope4 x, y, z;
};
inline Vec4 operator+(const Vec4& a, const Vec4& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec4 operator-(const Vec4& a, const Vec4& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec4 operator*(const Slope4& s, const Vec4& a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec4 cross(const Vec4& a, const Vec4& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Vec value(const Vec4& a) { return {a.x.v, a.y.v, a.z.v}; }
inline Vec slope(const Vec4& a, int k) { return {a.x.d[k], a.y.d[k], a.z.d[k]}; }

// sum over n of (-1)^n weight_n / (2 n + offset)! q^n; weight 1, or n for the derivative by q times q.
template <int kTerms> struct SineSeries {
  double value[kTerms] = {}, slope[kTerms] = {};
  explicit constexpr SineSeries(int offset) {
    double factorial = 1.0;
    for (int k = 2; k <= offset; ++k) factorial *= k;
    for (int n = 0; n < kTerms; ++n) {
      value[n] = (n % 2 == 0 ? 1.0 : -1.0) / factorial;
      if (n > 0) slope[n - 1] = n * value[n];
      factorial *= (2 * n + offset + 1) * (2 * n + offset + 2);
    }
  }
};

inline Slope4 polynomial(const double* terms, int count, const Slope4& q) {
  double v = 0.0, by_q = 0.0;
  for (int n = count - 1; n >= 0; --n) by_q = by_q * q.v + v, v = v * q.v + terms[n];
  Slope4 out(v);
  for (int k = 0; k < 4; ++k) out.d[k] = by_q * q.d[k];
  return out;
}

struct LocalElement {
  Vec spin[4], shift[4];              // axis and shift of each coordinate, in the frame of its start
  Vec spin_by[4][4], shift_by[4][4];  // [by this coordinate][of that one]
  Vec end;
  Mat turn;
};

inline LocalElement local_element(const double* strain, double length) {
  constexpr int kTerms = 12;
  static constexpr SineSeries<kTerms> kA(1), kB(2), kC(3);
  Slope4 x[4];
  for (int k = 0; k < 4; ++k) x[k] = Slope4(strain[k]), x[k].d[k] = 1.0;
  const Vec4 w{Slope4(0.0) - x[1], x[0], x[2]}, e3{0.0, 0.0, 1.0};
  const Slope4 q = w.x * w.x + w.y * w.y + w.z * w.z;
  const Slope4 b = polynomial(kB.value, kTerms, q), c = polynomial(kC.value, kTerms, q);
  const Slope4 db = polynomial(kB.slope, kTerms - 1, q), dc = polynomial(kC.slope, kTerms - 1, q);
  const double a = polynomial(kA.value, kTerms, q).v;
  const Slope4 stretched = Slope4(length) * (Slope4(1.0) + x[3]);
  const Vec4 across = cross(w, e3), twice = cross(w, across);
  const Vec4 chord = e3 + b * across + c * twice;
  const Vec4 units[3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
  const Slope4* parts[3] = {&w.x, &w.y, &w.z};
  Vec4 by_w[3], left[3];  // columns
  for (int n = 0; n < 3; ++n) {
    const Vec4 d_across = cross(units[n], e3), d_twice = cross(units[n], across) + cross(w, d_across);
    const Slope4 twofold = Slope4(2.0) * *parts[n];
    by_w[n] = (twofold * db) * across + b * d_across + (twofold * dc) * twice + c * d_twice;
    const Vec4 turned = cross(w, units[n]);
    left[n] = units[n] + b * turned + c * cross(w, turned);
  }
  const Slope4 minus(-1.0);
  const Vec4 bare = stretched * chord;
  const Vec4 spins[4] = {left[1], minus * left[0], left[2], {0.0, 0.0, 0.0}};
  const Vec4 plain[4] = {stretched * by_w[1], (minus * stretched) * by_w[0], stretched * by_w[2],
                         Slope4(length) * chord};
  LocalElement out;
  for (int k = 0; k < 4; ++k) {
    const Vec4 shift = plain[k] - cross(spins[k], bare);
    out.spin[k] = value(spins[k]), out.shift[k] = value(shift);
    for (int n = 0; n < 4; ++n) out.spin_by[n][k] = slope(spins[k], n), out.shift_by[n][k] = slope(shift, n);
  }
  out.end = value(bare);
  const Mat W = hat(value(w)), W2 = W * W;
  out.turn = identity();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.turn.m[i][j] += a * W.m[i][j] + b.v * W2.m[i][j];
  return out;
}

// A tendon along an element of the strains x: `root` is its length over h, `ratio` what of it goes along the backbone,
// `by` the derivative of its length by the strains. All are 0 where the tendon does not pass (an arm of NaN).
struct TendonPiece {
  double root = 0.0, ratio = 0.0, by[4] = {}, shortening = 0.0;
};

inline TendonPiece tendon_piece(const double* x, double h, const double* arm) {
  TendonPiece piece;
  if (std::isnan(arm[0])) return piece;
  const double squared = (arm[0] * arm[0] + arm[1] * arm[1]) / (h * h);
  const double along = 1.0 + x[3] - (arm[0] * x[0] + arm[1] * x[1]) / h;
  piece.root = std::sqrt(along * along + squared * x[2] * x[2]);
  piece.ratio = along / piece.root;
  piece.by[0] = -arm[0] * piece.ratio, piece.by[1] = -arm[1] * piece.ratio;
  piece.by[2] = h * squared * x[2] / piece.root, piece.by[3] = h * piece.ratio;
  piece.shortening = h * (1.0 - piece.root);
  return piece;
}

}  // namespace contid
