// One element of a rod, its rigid links and the loads at the ends of sections; contid/kinematics/cosserat/element.py
// has the equations.
#pragma once

#include "columns.hpp"

namespace contid {

// One element of reference length h by Runge, Kutta, Munthe-Kaas; element.step. N is the force at its start, f the
// distributed load. `keep` gets every stage.
template <class Keep>
[[gnu::always_inline]] inline void step(const Inflated& s, Pose& pose, Vec N, Vec f, double h, const Keep& keep) {
  const bool weighs = dot(f, f) > 0.0;
  Vec u[4], v[4], rate_mu[4] = {};
  Mat R = pose.R, half_R = pose.R;
  Vec p = pose.p, half_p = pose.p, mu = pose.mu;
#pragma GCC unroll 4
  for (int i = 0; i < 4; ++i) {
    const double c = i == 0 ? 0.0 : i == 3 ? 1.0 : 0.5;
    if (i > 0) {
      Mat turn;
      Vec shift;
      if (i < 3) {
        screw(0.5 * h * u[i - 1], 0.5 * h * v[i - 1], turn, shift);
        R = pose.R * turn;
        p = pose.p + pose.R * shift;
        if (i == 1) half_R = R, half_p = p;
      } else {  // g4 = g2 exp(k3 - k1/2): what makes the scheme free of commutators
        screw(h * (u[2] - 0.5 * u[0]), h * (v[2] - 0.5 * v[0]), turn, shift);
        R = half_R * turn;
        p = half_p + half_R * shift;
      }
      if (weighs) mu = pose.mu + c * h * rate_mu[i - 1];
    }
    const Vec force = weighs ? N - c * h * f : N;
    const Vec M = mu - cross(p, force);
    const Vec m = transposed_times(R, M), n = transposed_times(R, force);
    u[i] = {s.curvature_x + s.bend * m.x, s.curvature_y + s.bend * m.y, s.twist * m.z};
    v[i] = {s.shear * n.x, s.shear * n.y, 1.0 + s.strain + s.axial * n.z};
    if (weighs) rate_mu[i] = cross(f, p);
    keep(i, R, p, u[i], v[i], force, M);
  }
  const double k = h / 12.0;
  Mat turn;
  Vec shift;
  screw(k * (3.0 * u[0] + 2.0 * u[1] + 2.0 * u[2] - u[3]), k * (3.0 * v[0] + 2.0 * v[1] + 2.0 * v[2] - v[3]), turn,
        shift);
  pose.p = pose.p + pose.R * shift;
  pose.R = pose.R * turn;
  screw(k * (3.0 * u[3] + 2.0 * u[1] + 2.0 * u[2] - u[0]), k * (3.0 * v[3] + 2.0 * v[1] + 2.0 * v[2] - v[0]), turn,
        shift);
  pose.p = pose.p + pose.R * shift;
  pose.R = pose.R * turn;
  if (weighs) pose.mu = pose.mu + (h / 6.0) * (rate_mu[0] + 2.0 * rate_mu[1] + 2.0 * rate_mu[2] + rate_mu[3]);
}

inline void step(const Inflated& s, Pose& pose, Vec N, Vec f, double h) {
  step(s, pose, N, f, h, [](int, const Mat&, Vec, Vec, Vec, Vec, Vec) {});
}

// The same with the first `count` columns.
template <class Own>
inline void step(const Inflated& s, State& state, Vec N, Vec f, double h, const Own& own, int count) {
  Stage stages[4];
  step(s, state, N, f, h,
       [&](int i, const Mat& R, Vec p, Vec u, Vec v, Vec force, Vec M) { stages[i].set(s, R, p, u, v, force, M); });
  advance(s, stages, own, f, h, count, state.by);
}

// A rigid link of constant weight per length; element.link.
inline void link(Pose& pose, double length, Vec f) {
  const Vec e = column(pose.R, 2);
  pose.mu = pose.mu - length * cross(pose.p + 0.5 * length * e, f);
  pose.p = pose.p + length * e;
}

inline void link(State& state, double length, Vec f, int count) {
  const Vec e = column(state.R, 2);
  link(state, length, f);
  for (int j = 0; j < count; ++j) {
    const Vec w{state.by.turn[0][j], state.by.turn[1][j], state.by.turn[2][j]};
    const Vec moved = length * cross(w, e);
    const Vec old{state.by.shift[0][j], state.by.shift[1][j], state.by.shift[2][j]};
    const Vec moment = length * cross(f, old + 0.5 * moved);
    state.by.shift[0][j] += moved.x;
    state.by.shift[1][j] += moved.y;
    state.by.shift[2][j] += moved.z;
    state.by.dmu[0][j] += moment.x;
    state.by.dmu[1][j] += moment.y;
    state.by.dmu[2][j] += moment.z;
  }
}

// A dead wrench at the end of a section, N the force before it; statics.sweep.
inline void joint(Pose& pose, Vec force, Vec moment) { pose.mu = pose.mu - moment - cross(pose.p, force); }

inline void joint(State& state, Vec force, Vec moment, int count) {
  joint(state, force, moment);
  add_cross(force, state.by.shift, count, state.by.dmu);
}

}  // namespace contid
