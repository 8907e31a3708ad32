// Derivatives of a sweep, a column for each unknown; contid/kinematics/cosserat/element.py has their equations. Columns
// lie next to each other and are treated by the register: the bits do not depend on its width.
#pragma once

#include "rod.hpp"

namespace contid {

#ifdef __AVX__
constexpr int kLanes = 4;
#else
constexpr int kLanes = 2;
#endif
static_assert(kMostColumns % kLanes == 0);
typedef double Lanes __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));
inline Lanes& lanes(double& first) { return reinterpret_cast<Lanes&>(first); }
inline const Lanes& lanes(const double& first) { return reinterpret_cast<const Lanes&>(first); }

// Columns in whole registers.
constexpr int padded(int columns) { return (columns + kLanes - 1) / kLanes * kLanes; }

inline void clear(Columns& c, int count) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < padded(count); j += kLanes)
      lanes(c.turn[i][j]) = lanes(c.shift[i][j]) = lanes(c.dmu[i][j]) = Lanes{};
}

// out += a x columns, for the first `count`.
inline void add_cross(Vec a, const double (&in)[3][kMostColumns], int count, double (&out)[3][kMostColumns]) {
  for (int j = 0; j < count; j += kLanes) {
    const Lanes x = lanes(in[0][j]), y = lanes(in[1][j]), z = lanes(in[2][j]);
    lanes(out[0][j]) += a.y * z - a.z * y;
    lanes(out[1][j]) += a.z * x - a.x * z;
    lanes(out[2][j]) += a.x * y - a.y * x;
  }
}

// What the rates of the columns take from one stage of an element: frame, position, total force N and moment M there.
// With the tangent e = R e3, V = R v and a change of the frame by `turn`, element.py's
//
//     shift' = lever x turn + (along . turn) e,    lever = N / GA - V,    along = (1/EA - 1/GA) e x N;
//
// the pressures of the section itself add soft_turn and soft_shift, for they change its modulus and stretch it.
struct Stage {
  Mat R;
  Vec p, N, M, lever, along, soft_turn, soft_shift;

  void set(const Inflated& s, const Mat& frame, Vec position, Vec u, Vec v, Vec force, Vec moment) {
    R = frame, p = position, N = force, M = moment;
    const Vec e = column(R, 2), V = R * v;
    lever = s.shear * N - V, along = (s.axial - s.shear) * cross(e, N);
    soft_turn = s.softening * (R * u), soft_shift = s.strain_per_bar * e + s.softening * (V - e);
  }
};

// Columns of which no pressure belongs to the section: what a stage adds of its own is nothing.
struct NoOwnColumns {
  bool at(int) const { return false; }
  void add(const Stage&, int, Lanes (&)[3], Lanes (&)[3]) const {}
};

// The three columns of a section's own pressures, as factors for whole registers: loops over parts of one would wait
// for memory.
struct OwnColumns {
  static constexpr int kTouched = 2 * 4;  // three columns lie in two registers at most
  int first;
  double x[kTouched] = {}, y[kTouched] = {}, one[kTouched] = {};

  OwnColumns(const Inflated& s, int own) : first(own / kLanes * kLanes) {
    for (int k = 0; k < 3; ++k)
      x[own - first + k] = s.per_bar_x[k], y[own - first + k] = s.per_bar_y[k], one[own - first + k] = 1.0;
  }

  bool at(int column) const { return column >= first; }

  void add(const Stage& s, int column, Lanes (&turn)[3], Lanes (&shift)[3]) const {
    const int j = column - first;
    const Lanes a = lanes(x[j]), b = lanes(y[j]), c = lanes(one[j]);
    turn[0] += a * s.R.m[0][0] + b * s.R.m[0][1] + c * s.soft_turn.x;
    turn[1] += a * s.R.m[1][0] + b * s.R.m[1][1] + c * s.soft_turn.y;
    turn[2] += a * s.R.m[2][0] + b * s.R.m[2][1] + c * s.soft_turn.z;
    shift[0] += c * s.soft_shift.x, shift[1] += c * s.soft_shift.y, shift[2] += c * s.soft_shift.z;
  }
};

// The columns of a force on the tip, behind the three of the base moment.
struct ForceColumns {
  static constexpr double kAxes[3][8] = {{0, 0, 0, 1}, {0, 0, 0, 0, 1}, {0, 0, 0, 0, 0, 1}};
  const Inflated& inflated;

  bool at(int) const { return true; }

  void add(const Stage& s, int column, Lanes (&turn)[3], Lanes (&shift)[3]) const {
    const Vec e = contid::column(s.R, 2), p = s.p;
    const Lanes x = lanes(kAxes[0][column]), y = lanes(kAxes[1][column]), z = lanes(kAxes[2][column]);
    const Lanes mx = y * p.z - z * p.y, my = z * p.x - x * p.z, mz = x * p.y - y * p.x;
    const Lanes m = (inflated.twist - inflated.bend) * (e.x * mx + e.y * my + e.z * mz);
    turn[0] += inflated.bend * mx + m * e.x;
    turn[1] += inflated.bend * my + m * e.y;
    turn[2] += inflated.bend * mz + m * e.z;
    const Lanes n = (inflated.axial - inflated.shear) * (e.x * x + e.y * y + e.z * z);
    shift[0] += inflated.shear * x + n * e.x;
    shift[1] += inflated.shear * y + n * e.y;
    shift[2] += inflated.shear * z + n * e.z;
  }
};

// Moves the first `count` columns over an element of length h by Runge and Kutta's rule through its four stages; see
// element._tangent_rates. f is the distributed load; without it dmu is constant.
template <class Own>
inline void advance(const Inflated& s, const Stage (&stages)[4], const Own& own, Vec f, double h, int count,
                    Columns& by) {
  const bool weighs = dot(f, f) > 0.0;
  const double twist = s.twist - s.bend, w = h / 6.0;
  for (int j = 0; j < count; j += kLanes) {
    const Lanes t0[3] = {lanes(by.turn[0][j]), lanes(by.turn[1][j]), lanes(by.turn[2][j])};
    const Lanes q0[3] = {lanes(by.shift[0][j]), lanes(by.shift[1][j]), lanes(by.shift[2][j])};
    const Lanes m0[3] = {lanes(by.dmu[0][j]), lanes(by.dmu[1][j]), lanes(by.dmu[2][j])};
    Lanes t[3] = {t0[0], t0[1], t0[2]}, q[3] = {q0[0], q0[1], q0[2]}, d[3] = {m0[0], m0[1], m0[2]};
    Lanes sum_t[3], sum_q[3], sum_d[3];
#pragma GCC unroll 4
    for (int i = 0; i < 4; ++i) {
      const Stage& at = stages[i];
      const Vec N = at.N, M = at.M, e = column(at.R, 2);
      const Lanes mx = d[0] + (N.y * q[2] - N.z * q[1]) + (M.y * t[2] - M.z * t[1]);
      const Lanes my = d[1] + (N.z * q[0] - N.x * q[2]) + (M.z * t[0] - M.x * t[2]);
      const Lanes mz = d[2] + (N.x * q[1] - N.y * q[0]) + (M.x * t[1] - M.y * t[0]);
      const Lanes m = twist * (e.x * mx + e.y * my + e.z * mz);
      Lanes turn[3] = {s.bend * mx + m * e.x, s.bend * my + m * e.y, s.bend * mz + m * e.z};
      const Lanes n = at.along.x * t[0] + at.along.y * t[1] + at.along.z * t[2];
      Lanes shift[3] = {(at.lever.y * t[2] - at.lever.z * t[1]) + n * e.x,
                        (at.lever.z * t[0] - at.lever.x * t[2]) + n * e.y,
                        (at.lever.x * t[1] - at.lever.y * t[0]) + n * e.z};
      if (own.at(j)) own.add(at, j, turn, shift);
      const double ahead = i == 2 ? 1.0 * h : 0.5 * h;
      if (weighs) {
        const Lanes dmu[3] = {f.y * q[2] - f.z * q[1], f.z * q[0] - f.x * q[2], f.x * q[1] - f.y * q[0]};
        for (int a = 0; a < 3; ++a) {
          sum_d[a] = i == 0 ? dmu[a] : i == 3 ? sum_d[a] + dmu[a] : sum_d[a] + 2.0 * dmu[a];
          d[a] = m0[a] + ahead * dmu[a];
        }
      }
      for (int a = 0; a < 3; ++a) {
        sum_t[a] = i == 0 ? turn[a] : i == 3 ? sum_t[a] + turn[a] : sum_t[a] + 2.0 * turn[a];
        sum_q[a] = i == 0 ? shift[a] : i == 3 ? sum_q[a] + shift[a] : sum_q[a] + 2.0 * shift[a];
        t[a] = t0[a] + ahead * turn[a], q[a] = q0[a] + ahead * shift[a];
      }
    }
    for (int a = 0; a < 3; ++a) {
      lanes(by.turn[a][j]) = t0[a] + w * sum_t[a];
      lanes(by.shift[a][j]) = q0[a] + w * sum_q[a];
      if (weighs) lanes(by.dmu[a][j]) = m0[a] + w * sum_d[a];
    }
  }
}

}  // namespace contid
