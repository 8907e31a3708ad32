// The way from rest to a pose, kept for the poses next to it. Twin and specification:
// contid/kinematics/cosserat/ramp.py.
#pragma once

#include "branch.hpp"

namespace contid {

constexpr int kRampWork = 3;  // cost of following a path from rest, in steps of a descent

// Base moments on the way, before its end; the last ones are left out where there are too many.
template <int K> struct Ramp {
  static constexpr int kMost = 12;
  double part[kMost];
  Vec moment[kMost];
  int count = 0;
};

// `equilibrium` of a loaded rod that keeps the way.
template <int K>
double ramped(const Rod<K>& rod, const double* pressures, Vec tip_force, int elements, Vec& moment, Judged& out,
              Ramp<K>& ramp) {
  const double none[3 * K] = {};
  moment = {0, 0, 0};
  ramp.count = 0;
  return follow<K>(rod, {none, {0, 0, 0}, 0.0}, {pressures, tip_force, 1.0}, elements, moment, out,
                   [&](double part, Vec passed) {
                     if (part < 1.0 && ramp.count < Ramp<K>::kMost)
                       ramp.part[ramp.count] = part, ramp.moment[ramp.count++] = passed;
                   });
}

// True when the way from rest to an equilibrium runs next to a known one that ends at `before`; the ramp becomes it.
template <int K>
bool beside(const Rod<K>& rod, const double* pressures, Vec moment, Vec before, Vec tip_force, int elements,
            Ramp<K>& ramp) {
  const double near = kNear * load_scale<K>(rod, tip_force);
  Ramp<K> moved = ramp;
  Judged at;
  double p[3 * K];
  for (int k = 0; k < ramp.count; ++k) {
    const double part = ramp.part[k];
    for (int j = 0; j < 3 * K; ++j) p[j] = part * pressures[j];
    const Vec guess = ramp.moment[k] + part * (moment - before);
    judge<K>(rod, p, guess, part * tip_force, part, elements, at);
    const Vec left = at.moment_by_balance * at.ends.moment;
    if (at.modes != 0 || !(norm(left) <= near)) return false;
    moved.moment[k] = guess - left;
  }
  ramp = moved;
  return true;
}

// True when a stable equilibrium is the one of `equilibrium`; `ramp` is the way to one near it with moment `before`,
// and becomes the way to it. `work` grows where that has to be followed.
template <int K>
bool keeps_to_branch(const Rod<K>& rod, const double* pressures, Vec moment, Vec before, Vec tip_force, int elements,
                     Ramp<K>& ramp, int& work) {
  if (beside<K>(rod, pressures, moment, before, tip_force, elements, ramp)) return true;
  Ramp<K> other;
  Vec found;
  Judged at;
  work += kRampWork;
  if (ramped<K>(rod, pressures, tip_force, elements, found, at, other) < 1.0 ||
      norm(found - moment) > kSamePose * load_scale<K>(rod, tip_force))
    return false;
  ramp = other;
  return true;
}

}  // namespace contid
