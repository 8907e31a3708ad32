// An equilibrium near a known one, with the derivatives of the tip: a bounded piece of work for every tick. Twin of
// contid/kinematics/cosserat/near.py, its specification.
#pragma once

#include "branch.hpp"

namespace contid {

// Derivative of the tip by the force on it, pressures constant, of a rod in equilibrium; false at a critical load.
// Twin of contid/kinematics/cosserat/compliance.py.
template <int K>
bool tip_compliance(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements,
                    Mat& out) {
  constexpr int C = padded(6);
  State<C> state{identity(), {0, 0, 0}, base_moment, {}};
  for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
  Vec N = base_force<K>(rod, tip_force, 1.0);
  for (int i = 0; i < K; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      step<C, -1, 3>(inflated, state, N, section.weight, h);
      N = N - h * section.weight;
    }
    if (section.link > 0.0) {
      link<C>(state, section.link, section.link_weight);
      N = N - section.link * section.link_weight;
    }
  }
  add_cross<C>(tip_force, state.by.shift, state.by.dmu);
  Mat by_balance, unbalanced, free;
  const Mat lever = hat(state.p);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      unbalanced.m[i][j] = state.by.dmu[i][3 + j] - lever.m[i][j];
      free.m[i][j] = state.by.shift[i][3 + j];
    }
  if (!inverse(first_columns(state.by.dmu), by_balance)) return false;
  const Mat held = first_columns(state.by.shift) * (by_balance * unbalanced);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.m[i][j] = free.m[i][j] - held.m[i][j];
  return true;
}

template <int K> struct Near {
  Vec tip, moment;
  Mat by_force;               // [mm/N]
  double by_pressure[9 * K];  // [mm/bar], row-major
};

// At most kCorrections sweeps from a guess of the base moment, and two for the derivatives. False where Newton's method
// does not contract from there, or the equilibrium is unstable.
template <int K>
bool near(const Rod<K>& rod, const double* pressures, Vec tip_force, Vec guess, int elements, Near<K>& out) {
  Judged at;
  out.moment = guess;
  const double tolerance = statics_tolerance(load_scale<K>(rod, tip_force));
  if (!settle<K>(rod, pressures, out.moment, tip_force, 1.0, elements, tolerance, at)) return false;
  out.tip = at.ends.p;
  Sweep<K> tangents;
  sweep<K, true>(rod, pressures, out.moment, tip_force, 1.0, elements, tangents);
  for (int j = 0; j < 3 * K; ++j) {
    const Vec unbalanced{tangents.residual[0][3 + j], tangents.residual[1][3 + j], tangents.residual[2][3 + j]};
    const Vec held = at.tip_by_balance * unbalanced;
    const double part[3] = {held.x, held.y, held.z};
    for (int i = 0; i < 3; ++i) out.by_pressure[3 * K * i + j] = tangents.tip.by.shift[i][3 + j] - part[i];
  }
  return tip_compliance<K>(rod, pressures, out.moment, tip_force, elements, out.by_force);
}

}  // namespace contid
