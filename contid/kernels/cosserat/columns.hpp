// Derivatives of a sweep, a column for each unknown: twin of element._tangent_rates. Columns lie next to each other,
// so loops vectorise.
#pragma once

#include "section.hpp"

namespace contid {

// Columns are counted at compile time (`A` of them move), so that loops over them unroll into vector registers.
constexpr int padded(int columns) { return (columns + 1) / 2 * 2; }

// Derivatives by column: turn of the frame, shift of the position, change of mu.
template <int C> struct Columns {
  double turn[3][C], shift[3][C], dmu[3][C];
};

template <int C> void clear(Columns<C>& c) { c = {}; }

// out += a x columns, for the first A.
template <int A, int C> inline void add_cross(Vec a, const double (&in)[3][C], double (&out)[3][C]) {
  for (int j = 0; j < A; ++j) {
    const double x = in[0][j], y = in[1][j], z = in[2][j];
    out[0][j] += a.y * z - a.z * y;
    out[1][j] += a.z * x - a.x * z;
    out[2][j] += a.x * y - a.y * x;
  }
}

// out = a x columns, or out += a x columns.
template <int A, bool Add, int C> inline void times(const Mat& a, const double (&in)[3][C], double (&out)[3][C]) {
  for (int i = 0; i < 3; ++i) {
    const double a0 = a.m[i][0], a1 = a.m[i][1], a2 = a.m[i][2];
    for (int j = 0; j < A; ++j) {
      const double value = a0 * in[0][j] + a1 * in[1][j] + a2 * in[2][j];
      out[i][j] = Add ? out[i][j] + value : value;
    }
  }
}

// Rates of the columns at one stage; element._tangent_rates. The first `Base` columns (3 or none) belong to the
// base moment, `Own` is the first of this section's pressures and `Force` of a force on the tip (at position p), -1 for
// none. Without distributed load dmu is constant, for a massless rod the identity.
template <int A, int Base, int Own, int Force, int C>
[[gnu::always_inline]] inline void column_rates(const Inflated& s, const Mat& R, Vec p, const Columns<C>& at, Vec u,
                                                Vec v, Vec N, Vec M, Vec f, bool weighs, bool massless,
                                                Columns<C>& rate) {
  const Vec e = column(R, 2), V = R * v;
  // R diag(bend, bend, twist) R^T and the same for the shift, as matrices: every column is then 3x3 products.
  Mat bend, give;
  const double ev[3] = {e.x, e.y, e.z};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      bend.m[i][j] = (s.twist - s.bend) * ev[i] * ev[j] + (i == j ? s.bend : 0.0);
      give.m[i][j] = (s.axial - s.shear) * ev[i] * ev[j] + (i == j ? s.shear : 0.0);
    }
  const Mat by_shift = times_hat(bend, N), by_turn = times_hat(bend, M);
  Mat pull = times_hat(give, N);
  const Mat lever = hat(V);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) pull.m[i][j] -= lever.m[i][j];
  if (massless) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < A; ++j) rate.turn[i][j] = j < Base ? bend.m[i][j] : 0.0;
  } else {
    times<A, false>(bend, at.dmu, rate.turn);
  }
  times<A, true>(by_shift, at.shift, rate.turn);
  times<A, true>(by_turn, at.turn, rate.turn);
  times<A, false>(pull, at.turn, rate.shift);
  if (weighs) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < A; ++j) rate.dmu[i][j] = 0.0;
    add_cross<A>(f, at.shift, rate.dmu);
  }
  if constexpr (Force >= 0) {
    const Mat lever_of_tip = times_hat(bend, p);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        rate.turn[i][Force + j] -= lever_of_tip.m[i][j];
        rate.shift[i][Force + j] += give.m[i][j];
      }
  }
  if constexpr (Own >= 0) {
    const Vec soft_turn = s.softening * (R * u), soft_shift = s.strain_per_bar * e + s.softening * (V - e);
    const Vec ex = column(R, 0), ey = column(R, 1);
    for (int k = 0; k < 3; ++k) {
      const Vec turn = s.per_bar_x[k] * ex + s.per_bar_y[k] * ey + soft_turn;
      rate.turn[0][Own + k] += turn.x;
      rate.turn[1][Own + k] += turn.y;
      rate.turn[2][Own + k] += turn.z;
      rate.shift[0][Own + k] += soft_shift.x;
      rate.shift[1][Own + k] += soft_shift.y;
      rate.shift[2][Own + k] += soft_shift.z;
    }
  }
}

template <int A, int C>
inline void ahead(const Columns<C>& from, const Columns<C>& rate, double h, bool weighs, Columns<C>& to) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < A; ++j) to.turn[i][j] = from.turn[i][j] + h * rate.turn[i][j];
    for (int j = 0; j < A; ++j) to.shift[i][j] = from.shift[i][j] + h * rate.shift[i][j];
    if (weighs)
      for (int j = 0; j < A; ++j) to.dmu[i][j] = from.dmu[i][j] + h * rate.dmu[i][j];
  }
}

}  // namespace contid
