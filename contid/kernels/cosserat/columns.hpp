// Derivatives of a sweep, a column for each unknown: twin of element._tangent_rates. Columns lie next to each other,
// so loops vectorise.
#pragma once

#include "section.hpp"

namespace contid {

// Columns are counted at compile time (`A` of them move) and treated by the register: the bits do not depend on its
// width.
#ifdef __AVX__
constexpr int kLanes = 4;
#else
constexpr int kLanes = 2;
#endif
typedef double Lanes __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));
inline Lanes& lanes(double& first) { return reinterpret_cast<Lanes&>(first); }
inline const Lanes& lanes(const double& first) { return reinterpret_cast<const Lanes&>(first); }

constexpr int padded(int columns) { return (columns + kLanes - 1) / kLanes * kLanes; }

// Derivatives by column: turn of the frame, shift of the position, change of mu.
template <int C> struct Columns {
  double turn[3][C], shift[3][C], dmu[3][C];
};

template <int C> void clear(Columns<C>& c) { c = {}; }

// out += a x columns, for the first A.
template <int A, int C> inline void add_cross(Vec a, const double (&in)[3][C], double (&out)[3][C]) {
  for (int j = 0; j < A; j += kLanes) {
    const Lanes x = lanes(in[0][j]), y = lanes(in[1][j]), z = lanes(in[2][j]);
    lanes(out[0][j]) += a.y * z - a.z * y;
    lanes(out[1][j]) += a.z * x - a.x * z;
    lanes(out[2][j]) += a.x * y - a.y * x;
  }
}

// The three columns of a section's own pressures, the first of them `Own`, as factors for all: loops over parts of a
// vector register would wait for memory.
template <int A, int Own> struct OwnColumns {
  static constexpr int kFirst = Own / kLanes * kLanes;
  double x[A] = {}, y[A] = {}, one[A] = {};

  explicit OwnColumns(const Inflated& s) {
    for (int k = 0; k < 3; ++k) x[Own + k] = s.per_bar_x[k], y[Own + k] = s.per_bar_y[k], one[Own + k] = 1.0;
  }
};
struct NoColumns {
  explicit NoColumns(const Inflated&) {}
};

// Rates of the columns at one stage; element._tangent_rates. `Own` is the first column of this section's pressures and
// `Force` that of a force on the tip (at position p), -1 for none. Without distributed load dmu is constant.
template <int A, int Own, int Force, int C, class OwnFactors>
[[gnu::always_inline]] inline void column_rates(const Inflated& s, const OwnFactors& own, const Mat& R, Vec p,
                                                const Columns<C>& at, Vec u, Vec v, Vec N, Vec M, Vec f, bool weighs,
                                                Columns<C>& rate) {
  const Vec e = column(R, 2), V = R * v;
  const double twist = s.twist - s.bend;
  const Vec lever = s.shear * N - V, along = (s.axial - s.shear) * cross(e, N);
  for (int j = 0; j < A; j += kLanes) {
    const Lanes tx = lanes(at.turn[0][j]), ty = lanes(at.turn[1][j]), tz = lanes(at.turn[2][j]);
    const Lanes qx = lanes(at.shift[0][j]), qy = lanes(at.shift[1][j]), qz = lanes(at.shift[2][j]);
    const Lanes mx = lanes(at.dmu[0][j]) + (N.y * qz - N.z * qy) + (M.y * tz - M.z * ty);
    const Lanes my = lanes(at.dmu[1][j]) + (N.z * qx - N.x * qz) + (M.z * tx - M.x * tz);
    const Lanes mz = lanes(at.dmu[2][j]) + (N.x * qy - N.y * qx) + (M.x * ty - M.y * tx);
    const Lanes m = twist * (e.x * mx + e.y * my + e.z * mz);
    lanes(rate.turn[0][j]) = s.bend * mx + m * e.x;
    lanes(rate.turn[1][j]) = s.bend * my + m * e.y;
    lanes(rate.turn[2][j]) = s.bend * mz + m * e.z;
    const Lanes n = along.x * tx + along.y * ty + along.z * tz;
    lanes(rate.shift[0][j]) = (lever.y * tz - lever.z * ty) + n * e.x;
    lanes(rate.shift[1][j]) = (lever.z * tx - lever.x * tz) + n * e.y;
    lanes(rate.shift[2][j]) = (lever.x * ty - lever.y * tx) + n * e.z;
    if (weighs) {
      lanes(rate.dmu[0][j]) = f.y * qz - f.z * qy;
      lanes(rate.dmu[1][j]) = f.z * qx - f.x * qz;
      lanes(rate.dmu[2][j]) = f.x * qy - f.y * qx;
    }
  }
  if constexpr (Force >= 0) {
    for (int j = 0; j < 3; ++j) {
      const Vec axis{j == 0 ? 1.0 : 0.0, j == 1 ? 1.0 : 0.0, j == 2 ? 1.0 : 0.0}, moment = cross(axis, p);
      const Vec turn = s.bend * moment + (twist * dot(e, moment)) * e;
      const Vec shift = s.shear * axis + ((s.axial - s.shear) * dot(e, axis)) * e;
      rate.turn[0][Force + j] += turn.x, rate.turn[1][Force + j] += turn.y, rate.turn[2][Force + j] += turn.z;
      rate.shift[0][Force + j] += shift.x, rate.shift[1][Force + j] += shift.y, rate.shift[2][Force + j] += shift.z;
    }
  }
  if constexpr (Own >= 0) {
    const Vec soft_turn = s.softening * (R * u), soft_shift = s.strain_per_bar * e + s.softening * (V - e);
    const Vec ex = column(R, 0), ey = column(R, 1);
    for (int j = OwnFactors::kFirst; j < A; j += kLanes) {
      const Lanes x = lanes(own.x[j]), y = lanes(own.y[j]), one = lanes(own.one[j]);
      lanes(rate.turn[0][j]) += x * ex.x + y * ey.x + one * soft_turn.x;
      lanes(rate.turn[1][j]) += x * ex.y + y * ey.y + one * soft_turn.y;
      lanes(rate.turn[2][j]) += x * ex.z + y * ey.z + one * soft_turn.z;
      lanes(rate.shift[0][j]) += one * soft_shift.x;
      lanes(rate.shift[1][j]) += one * soft_shift.y;
      lanes(rate.shift[2][j]) += one * soft_shift.z;
    }
  }
}

template <int A, int C>
inline void ahead(const Columns<C>& from, const Columns<C>& rate, double h, bool weighs, Columns<C>& to) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < A; j += kLanes) {
      lanes(to.turn[i][j]) = lanes(from.turn[i][j]) + h * lanes(rate.turn[i][j]);
      lanes(to.shift[i][j]) = lanes(from.shift[i][j]) + h * lanes(rate.shift[i][j]);
      if (weighs) lanes(to.dmu[i][j]) = lanes(from.dmu[i][j]) + h * lanes(rate.dmu[i][j]);
    }
}

}  // namespace contid
