// The straight path in pressures from where the arm stands to an answer. Twin and specification:
// contid/kinematics/cosserat/along_branch/straight_path.py.
#pragma once

#include "../solve.hpp"

namespace contid {

constexpr double kFine = 1.0;  // [mm]
// Instead of the part of a path at which the arm snaps through: it does not, and ends where it should.
constexpr double kNoSnap = 2.0;

// True for an outcome on the target or next to it: the arm must get there on the straight path.
template <int K> bool at_target(const Outcome<K>& o) { return o.met || o.residual <= kFine; }

// The part of the path from an equilibrium to another at which the arm snaps through; 1 where it ends elsewhere without
// a snap.
template <int K>
double snap_on_path(const Rod<K>& rod, Vec tip_force, const double* here, Vec moment, const Outcome<K>& o,
                    int elements) {
  Judged at;
  const double done = follow<K>(rod, {here, tip_force, 1.0}, {o.pressures, tip_force, 1.0}, elements, moment, at);
  return done == 1.0 && same_pose<K>(rod, tip_force, moment, o.moment) ? kNoSnap : done;
}

// Where the arm stands: the equilibrium of the seed within the limits; false where the elements find none.
template <int K>
bool standing(const Rod<K>& rod, Vec tip_force, const Limits<K>& limits, const double* seed, int elements, double* here,
              Vec& moment, Judged& at) {
  std::copy(seed, seed + 3 * K, here);
  clamp<K>(limits, here);
  return equilibrium<K>(rod, here, tip_force, elements, moment, at) == 1.0;
}

// snap_on_path from where the arm stands with the seed; kNoSnap too where it has no equilibrium there.
template <int K>
double snap_from(const Rod<K>& rod, Vec tip_force, const Limits<K>& limits, const double* seed, const Outcome<K>& o,
                 int elements) {
  double here[3 * K];
  Vec moment;
  Judged at;
  if (!standing<K>(rod, tip_force, limits, seed, elements, here, moment, at)) return kNoSnap;
  return snap_on_path<K>(rod, tip_force, here, moment, o, elements);
}

// True when the arm gets from the seed to an equilibrium, or has none at the seed.
template <int K>
bool reached_from(const Rod<K>& rod, Vec tip_force, const Limits<K>& limits, const double* seed, const Outcome<K>& o,
                  int elements) {
  return snap_from<K>(rod, tip_force, limits, seed, o, elements) == kNoSnap;
}

// True where an answer is the equilibrium of its pressures on the branch.
template <int K> bool holds(const Rod<K>& rod, Vec tip_force, const Outcome<K>& o, int elements) {
  Vec moment;
  Judged at;
  return equilibrium<K>(rod, o.pressures, tip_force, elements, moment, at) == 1.0 &&
         same_pose<K>(rod, tip_force, moment, o.moment);
}

// True for an equilibrium that is a minimum of energy.
template <int K> bool is_stable(const Rod<K>& rod, Vec tip_force, Outcome<K>& o, int elements) {
  if (o.statics > kBalance) return false;
  if (!loaded<K>(rod, tip_force)) return true;
  if (o.at.modes < 0) judge<K>(rod, o.pressures, o.moment, tip_force, 1.0, elements, o.at);
  return o.at.modes == 0;
}

}  // namespace contid
