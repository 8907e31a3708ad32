// Moment balance and the stability of an equilibrium: twins of contid/kinematics/cosserat/{equilibrium,stability}.py.
#pragma once

#include "rod.hpp"

namespace contid {

constexpr double kStatics = 1e-9;    // moment balance that counts as equilibrium [N*mm]
constexpr double kRounding = 1e-12;  // the same, as a part of the moment of all loads, where that is more
constexpr int kNewtonSteps = 25;

inline bool finite(Vec a) { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }

template <int C> Mat first_columns(const double (&rows)[3][C]) {
  Mat a;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a.m[i][j] = rows[i][j];
  return a;
}

// Newton on the base moment at fixed pressures; `out` keeps the sweep with derivatives.
template <int K>
bool newton(const Rod<K>& rod, const double* pressures, Vec& moment, Vec tip_force, double share, int elements,
            Sweep<K>& out) {
  sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
  for (int i = 0; i < kNewtonSteps; ++i) {
    const double error = norm(out.moment);
    if (error <= kStatics) return true;
    Mat inv;
    if (!std::isfinite(error) || !inverse(first_columns(out.residual), inv)) return false;
    const Vec full = inv * out.moment, from = moment;
    bool better = false;
    for (double fraction = 1.0; fraction > 0.05 && !better; fraction *= 0.5) {
      moment = from - fraction * full;
      sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
      better = norm(out.moment) < error;
    }
    if (!better) {
      moment = from;
      sweep<K, true>(rod, pressures, moment, tip_force, share, elements, out);
      return false;
    }
  }
  return norm(out.moment) <= kStatics;
}

// Negative roots of det(x - a) when all three are real: Descartes' count of sign changes is then exact.
inline int negative(const Mat& a) {
  const auto& m = a.m;
  const double c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1], c1 = m[1][0] * m[2][2] - m[1][2] * m[2][0],
               c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
  const double sign[3] = {m[0][0] + m[1][1] + m[2][2],
                          c0 + m[0][0] * m[2][2] - m[0][2] * m[2][0] + m[0][0] * m[1][1] - m[0][1] * m[1][0],
                          m[0][0] * c0 - m[0][1] * c1 + m[0][2] * c2};
  int changes = 0;
  bool last = true;
  for (double value : sign) {
    if (value == 0.0) continue;
    changes += (value > 0.0) != last;
    last = value > 0.0;
  }
  return changes;
}

// A sweep with the columns of the base moment: where it ends, how both points follow the moment balance, and how many
// directions are unstable (valid in equilibrium; 0 means stable).
struct Judged {
  Ends ends;
  Mat moment_by_balance, tip_by_balance, mid_by_balance;
  int modes;
  bool regular;  // false at a critical load, where the matrices are undefined
};

// Three columns suffice (a fourth, zero, fills the vector registers).
template <int K>
void judge(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
           Judged& out) {
  if (rod.arcs) {  // nothing that could buckle it
    Sweep<K> at;
    sweep<K, false>(rod, pressures, base_moment, tip_force, share, elements, at);
    out = {at.ends(), identity(), {}, {}, 0, true};
    return;
  }
  constexpr int C = 4;
  State<C> state;
  state.R = identity();
  state.p = {0, 0, 0};
  state.mu = base_moment;
  clear(state.by);
  for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
  Vec N = base_force<K>(rod, tip_force, share);
  Mat before = identity(), mid_by_moment{};
  bool first = true, regular = true;
  out.modes = 0;
  for (int i = 0; i < K; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const Vec f = share * section.weight;
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      step<C, -1>(inflated, state, N, f, h);
      N = N - h * f;
      const Mat turn = first_columns(state.by.turn);
      if (!first) out.modes += negative(turn * before);
      first = false;
      regular = inverse(turn, before) && regular;
    }
    if (i == 0) out.ends.mid = state.p, mid_by_moment = first_columns(state.by.shift);
    if (rod.joints) {
      joint<C>(state, share * section.end_force, share * section.end_moment);
      N = N - share * section.end_force;
    }
    if (section.link > 0.0) {
      const Vec lf = share * section.link_weight;
      link<C>(state, section.link, lf);
      N = N - section.link * lf;
    }
  }
  out.ends.R = state.R;
  out.ends.p = state.p;
  out.ends.moment = state.mu - cross(state.p, tip_force) - share * rod.tip_moment;
  add_cross<C>(tip_force, state.by.shift, state.by.dmu);
  out.regular = inverse(first_columns(state.by.dmu), out.moment_by_balance) && regular;
  if (!out.regular) {
    out.modes = 3 * K;
    return;
  }
  out.tip_by_balance = first_columns(state.by.shift) * out.moment_by_balance;
  out.mid_by_balance = mid_by_moment * out.moment_by_balance;
  Mat stiffness = first_columns(state.by.dmu) * before;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j) stiffness.m[i][j] = stiffness.m[j][i] = 0.5 * (stiffness.m[i][j] + stiffness.m[j][i]);
  out.modes += negative(stiffness);
}

}  // namespace contid
