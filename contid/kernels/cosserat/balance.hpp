// Equilibrium and its stability: twins of contid/kinematics/cosserat/{equilibrium,stability}.py.
#pragma once

#include "rod.hpp"

namespace contid {

constexpr double kStatics = 1e-9;  // moment balance that counts as equilibrium [N*mm]
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

// Equilibrium on the branch that grows out of the unloaded shape.
template <int K>
bool equilibrium(const Rod<K>& rod, const double* pressures, Vec tip_force, double share, int elements, Vec& moment,
                 Sweep<K>& out) {
  moment = {0, 0, 0};
  newton<K>(rod, pressures, moment, {0, 0, 0}, 0.0, elements, out);
  Sweep<K> trial;
  double reached = 0.0, step = 0.25;
  while (reached < 1.0 && step > 1e-3) {
    const double goal = std::fmin(1.0, reached + step);
    Vec start = moment + (goal - reached) * cross(out.tip.p, tip_force);
    const bool good = newton<K>(rod, pressures, start, goal * tip_force, goal * share, elements, trial);
    if (good && norm(trial.tip.p - out.tip.p) < 0.3 * rod.reach) {
      moment = start;
      out = trial;
      reached = goal;
      step *= 2.0;
    } else {
      step *= 0.5;
    }
  }
  return reached >= 1.0;
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

// A sweep that also counts the unstable modes, valid in equilibrium; 0 means stable. Three columns suffice (a fourth,
// zero, fills the vector registers). Also sets the tip by the moment balance, unless that is singular.
template <int K>
int count_modes(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
                Ends& ends, Mat& tip_by_balance) {
  constexpr int C = 4;
  State<C> state;
  state.R = identity();
  state.p = {0, 0, 0};
  state.mu = base_moment;
  clear(state.by);
  for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
  Vec N = tip_force;
  for (int i = 0; i < K; ++i) N = N + share * own_weight(rod.sections[i]);
  Mat before = identity();
  int modes = 0;
  const bool light = massless<K>(rod, share);
  bool first = true, regular = true;
  for (int i = 0; i < K; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const Vec f = share * section.weight;
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      step<C, 3, -1>(inflated, state, N, f, light, h);
      N = N - h * f;
      const Mat turn = first_columns(state.by.turn);
      if (!first) modes += negative(turn * before);
      first = false;
      regular = inverse(turn, before) && regular;
    }
    if (i == 0) ends.mid = state.p;
    if (section.link > 0.0) {
      const Vec lf = share * section.link_weight;
      link<C>(state, section.link, lf);
      N = N - section.link * lf;
    }
  }
  ends.R = state.R;
  ends.p = state.p;
  ends.moment = state.mu - cross(state.p, tip_force);
  add_cross<C>(tip_force, state.by.shift, state.by.dmu);
  Mat balance;
  regular = inverse(first_columns(state.by.dmu), balance) && regular;
  if (!regular) return 3 * K;
  tip_by_balance = first_columns(state.by.shift) * balance;
  Mat stiffness = first_columns(state.by.dmu) * before;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j) stiffness.m[i][j] = stiffness.m[j][i] = 0.5 * (stiffness.m[i][j] + stiffness.m[j][i]);
  return modes + negative(stiffness);
}

template <int K>
int unstable_modes(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, double share,
                   int elements) {
  Ends ends;
  Mat unused;
  return count_modes<K>(rod, pressures, base_moment, tip_force, share, elements, ends, unused);
}

// True when anything acts on the rod; without load every equilibrium is stable and the strains are constant.
template <int K> bool loaded(const Rod<K>& rod, Vec tip_force) {
  bool any = norm(tip_force) > 0.0;
  for (int i = 0; i < K; ++i) any = any || norm(own_weight(rod.sections[i])) > 0.0;
  return any;
}

// Least factor of the tip force at which the branch from the unloaded shape loses its stability; -1 when it is stable
// up to `max_factor`, 0 when the own weight alone buckles it.
template <int K>
double critical_factor(const Rod<K>& rod, const double* pressures, Vec tip_force, double max_factor, int elements) {
  Sweep<K> scratch;
  const auto stable = [&](double factor) {
    Vec moment;
    return equilibrium<K>(rod, pressures, factor * tip_force, 1.0, elements, moment, scratch) &&
           unstable_modes<K>(rod, pressures, moment, factor * tip_force, 1.0, elements) == 0;
  };
  if (stable(max_factor)) return -1.0;
  if (!stable(0.0)) return 0.0;
  double low = 0.0, high = max_factor;
  while (high - low > 1e-3 * high) {
    const double middle = 0.5 * (low + high);
    (stable(middle) ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace contid
