// Statics of a pneumatic rod: one sweep from base to tip, with derivatives.
//
// Twins and specification: contid/kinematics/cosserat/{element,statics}.py; the second holds the equations.
// Units: mm, N, N*mm, bar. C++17, no allocation, no exceptions.
#pragma once

#include <algorithm>
#include <type_traits>

#include "arcs.hpp"
#include "columns.hpp"

namespace contid {

template <int C> struct State {
  Mat R;
  Vec p, mu;
  Columns<C> by;
};

// One element of reference length h; element.step. N is the force at its start; A = 0: no columns.
template <int A, int Own, int Force = -1, int C>
inline void step(const Inflated& s, State<C>& state, Vec N, Vec f, double h) {
  const bool weighs = dot(f, f) > 0.0;
  constexpr bool Tangents = A > 0;
  Vec u[4], v[4], rate_mu[4];
  Mat R = state.R, half_R = state.R;
  Vec p = state.p, half_p = state.p, mu = state.mu;
  Columns<C> rate[Tangents ? 4 : 1], at;
  if constexpr (Tangents) at = state.by;
  const std::conditional_t<(Own >= 0 && Tangents), OwnColumns<A, Own>, NoColumns> own(s);
  for (int i = 0; i < 4; ++i) {
    const double c = i == 0 ? 0.0 : i == 3 ? 1.0 : 0.5;
    if (i > 0) {
      Mat turn;
      Vec shift;
      if (i < 3) {
        screw(0.5 * h * u[i - 1], 0.5 * h * v[i - 1], turn, shift);
        R = state.R * turn;
        p = state.p + state.R * shift;
        if (i == 1) half_R = R, half_p = p;
      } else {  // g4 = g2 exp(k3 - k1/2): what makes the scheme free of commutators
        screw(h * (u[2] - 0.5 * u[0]), h * (v[2] - 0.5 * v[0]), turn, shift);
        R = half_R * turn;
        p = half_p + half_R * shift;
      }
      if (weighs) mu = state.mu + c * h * rate_mu[i - 1];
      if constexpr (Tangents) ahead<A>(state.by, rate[i - 1], c * h, weighs, at);
    }
    const Vec force = weighs ? N - c * h * f : N;
    const Vec M = mu - cross(p, force);
    const Vec m = transposed_times(R, M), n = transposed_times(R, force);
    u[i] = {s.curvature_x + s.bend * m.x, s.curvature_y + s.bend * m.y, s.twist * m.z};
    v[i] = {s.shear * n.x, s.shear * n.y, 1.0 + s.strain + s.axial * n.z};
    if (weighs) rate_mu[i] = cross(f, p);
    if constexpr (Tangents) column_rates<A, Own, Force>(s, own, R, p, at, u[i], v[i], force, M, f, weighs, rate[i]);
  }
  const double k = h / 12.0;
  Mat turn;
  Vec shift;
  screw(k * (3.0 * u[0] + 2.0 * u[1] + 2.0 * u[2] - u[3]), k * (3.0 * v[0] + 2.0 * v[1] + 2.0 * v[2] - v[3]), turn,
        shift);
  state.p = state.p + state.R * shift;
  state.R = state.R * turn;
  screw(k * (3.0 * u[3] + 2.0 * u[1] + 2.0 * u[2] - u[0]), k * (3.0 * v[3] + 2.0 * v[1] + 2.0 * v[2] - v[0]), turn,
        shift);
  state.p = state.p + state.R * shift;
  state.R = state.R * turn;
  if (weighs) state.mu = state.mu + (h / 6.0) * (rate_mu[0] + 2.0 * rate_mu[1] + 2.0 * rate_mu[2] + rate_mu[3]);
  if constexpr (Tangents) {
    const double w = h / 6.0;
    const auto sum = [&](double (&to)[3][C], const double (&a)[3][C], const double (&b)[3][C], const double (&c)[3][C],
                         const double (&d)[3][C]) {
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < A; j += kLanes)
          lanes(to[i][j]) += w * (lanes(a[i][j]) + 2.0 * lanes(b[i][j]) + 2.0 * lanes(c[i][j]) + lanes(d[i][j]));
    };
    sum(state.by.turn, rate[0].turn, rate[1].turn, rate[2].turn, rate[3].turn);
    sum(state.by.shift, rate[0].shift, rate[1].shift, rate[2].shift, rate[3].shift);
    if (weighs) sum(state.by.dmu, rate[0].dmu, rate[1].dmu, rate[2].dmu, rate[3].dmu);
  }
}

// A rigid link of constant weight per length; element.link.
template <int A, int C> inline void link(State<C>& state, double length, Vec f) {
  const Vec e = column(state.R, 2);
  state.mu = state.mu - length * cross(state.p + 0.5 * length * e, f);
  state.p = state.p + length * e;
  if constexpr (A > 0) {
    for (int j = 0; j < A; ++j) {
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
}

// A dead wrench at the end of a section, N the force before it; statics.sweep.
template <int A, int C> inline void joint(State<C>& state, Vec force, Vec moment) {
  state.mu = state.mu - moment - cross(state.p, force);
  if constexpr (A > 0) add_cross<A>(force, state.by.shift, state.by.dmu);
}

// Sections from base to tip with their own weight and the loads at their ends; the share of a sweep scales these.
template <int K> struct Rod {
  Section sections[K];
  double reach;
  Vec tip_moment = {0, 0, 0};
  bool joints = false, moments = false;  // true with a force or a moment at the end of a section; with any moment
  bool arcs = false;                     // true where it carries nothing, and its sections are arcs
};

// Where a sweep ends: frame and position of the tip, end of the first section, moment residual.
struct Ends {
  Mat R;
  Vec p, mid, moment;
};

// Result of a sweep: tip, frame, end of the first section, moment residual, and derivatives of all four with
// respect to the base moment (Base = 3; 0 leaves it out) and the pressures.
template <int K, int Base = 3> struct Sweep {
  static constexpr int kBase = Base, C = padded(Base + 3 * K);
  State<C> tip;
  Vec mid, moment;
  double mid_shift[3][C], residual[3][C];
  Ends ends() const { return {tip.R, tip.p, mid, moment}; }
};

inline Vec own_weight(const Section& s) { return s.length * s.weight + s.link * s.link_weight; }

// Force at the base: everything the rod carries.
template <int K> Vec base_force(const Rod<K>& rod, Vec tip_force, double share) {
  Vec N = tip_force;
  for (const Section& s : rod.sections) N = N + share * own_weight(s);
  if (rod.joints)
    for (const Section& s : rod.sections) N = N + share * s.end_force;
  return N;
}

// True without own weight and forces at the ends of sections.
template <int K> bool massless(const Rod<K>& rod, double share) {
  if (rod.joints && share != 0.0) return false;
  double most = 0.0;
  for (const Section& s : rod.sections) {
    const Vec a = share * s.weight, b = share * s.link_weight;
    most = std::max(most, dot(a, a) + dot(b, b));
  }
  return most == 0.0;
}

// Section I and those above it; N is the force at its base.
template <int K, bool Tangents, int I, int Base>
inline void sections(const Rod<K>& rod, const double* pressures, double share, int elements, Vec N,
                     Sweep<K, Base>& out) {
  constexpr int C = Sweep<K, Base>::C, Own = Base + 3 * I, A = Tangents ? padded(Own + 3) : 0;
  State<C>& state = out.tip;
  const Section& section = rod.sections[I];
  const Inflated inflated = inflate(section, pressures + 3 * I);
  const Vec f = share * section.weight;
  const double h = section.length / elements;
  for (int k = 0; k < elements; ++k) {
    step<A, Own>(inflated, state, N, f, h);
    N = N - h * f;
  }
  if constexpr (I == 0) {
    out.mid = state.p;
    if constexpr (Tangents)
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < C; ++j) out.mid_shift[a][j] = state.by.shift[a][j];
  }
  if (rod.joints) {
    joint<A>(state, share * section.end_force, share * section.end_moment);
    N = N - share * section.end_force;
  }
  if (section.link > 0.0) {
    const Vec lf = share * section.link_weight;
    link<A>(state, section.link, lf);
    N = N - section.link * lf;
  }
  if constexpr (I + 1 < K) sections<K, Tangents, I + 1, Base>(rod, pressures, share, elements, N, out);
}

// share scales the own weight, for continuation.
template <int K, bool Tangents, int Base>
inline void sweep(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, double share,
                  int elements, Sweep<K, Base>& out) {
  constexpr int C = Sweep<K, Base>::C;
  State<C>& state = out.tip;
  state.R = identity();
  state.p = {0, 0, 0};
  state.mu = base_moment;
  if constexpr (Tangents) {
    clear(state.by);
    for (int i = 0; i < Base; ++i) state.by.dmu[i][i] = 1.0;
  }
  if (rod.arcs) {
    arc_sections<K, Tangents, 0>(rod, pressures, elements, out);
    out.moment = base_moment;
    if constexpr (Tangents) std::copy(&state.by.dmu[0][0], &state.by.dmu[0][0] + 3 * C, &out.residual[0][0]);
    return;
  }
  sections<K, Tangents, 0, Base>(rod, pressures, share, elements, base_force<K>(rod, tip_force, share), out);
  out.moment = state.mu - cross(state.p, tip_force) - share * rod.tip_moment;
  if constexpr (Tangents) {
    for (int a = 0; a < 3; ++a)
      for (int j = 0; j < C; ++j) out.residual[a][j] = state.by.dmu[a][j];
    add_cross<C>(tip_force, state.by.shift, out.residual);
  }
}

}  // namespace contid
