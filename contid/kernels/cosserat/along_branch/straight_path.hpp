// The straight path in pressures from where the arm stands to an answer, and whether an answer counts.
#pragma once

#include "../solve.hpp"

namespace contid {

constexpr double kFine = 1.0;  // [mm]
// Instead of the part of a path at which the arm snaps through: it does not, and ends where it should.
constexpr double kNoSnap = 2.0;

// True for an outcome on the target or next to it: the arm must get there on the straight path.
inline bool at_target(const Outcome& o) { return o.met || o.residual <= kFine; }

// The part of the path from an equilibrium to another at which the arm snaps through; 1 where it ends elsewhere without
// a snap.
inline double snap_on_path(const Rod& rod, Vec tip_force, const double* here, Vec moment, const Outcome& o,
                           int elements) {
  Judged at;
  const double done = follow(rod, {here, tip_force, 1.0}, {o.pressures, tip_force, 1.0}, elements, moment, at);
  return done == 1.0 && same_pose(rod, tip_force, moment, o.moment) ? kNoSnap : done;
}

// Where the arm stands: the equilibrium of the seed within the limits; false where the elements find none.
inline bool standing(const Rod& rod, Vec tip_force, const Limits& limits, const double* seed, int elements,
                     double* here, Vec& moment, Judged& at) {
  std::copy(seed, seed + rod.pressures(), here);
  clamp(limits, here);
  return equilibrium(rod, here, tip_force, elements, moment, at) == 1.0;
}

// snap_on_path from where the arm stands with the seed; kNoSnap too where it has no equilibrium there.
inline double snap_from(const Rod& rod, Vec tip_force, const Limits& limits, const double* seed, const Outcome& o,
                        int elements) {
  double here[kMost];
  Vec moment;
  Judged at;
  if (!standing(rod, tip_force, limits, seed, elements, here, moment, at)) return kNoSnap;
  return snap_on_path(rod, tip_force, here, moment, o, elements);
}

// True when the arm gets from the seed to an equilibrium, or has none at the seed.
inline bool reached_from(const Rod& rod, Vec tip_force, const Limits& limits, const double* seed, const Outcome& o,
                         int elements) {
  return snap_from(rod, tip_force, limits, seed, o, elements) == kNoSnap;
}

// True where an answer is the equilibrium of its pressures on the branch.
inline bool holds(const Rod& rod, Vec tip_force, const Outcome& o, int elements) {
  Vec moment;
  Judged at;
  return equilibrium(rod, o.pressures, tip_force, elements, moment, at) == 1.0 &&
         same_pose(rod, tip_force, moment, o.moment);
}

// True for an equilibrium that is a minimum of energy.
inline bool is_stable(const Rod& rod, Vec tip_force, Outcome& o, int elements) {
  if (o.statics > kBalance) return false;
  if (!loaded(rod, tip_force)) return true;
  if (o.at.modes < 0) judge(rod, o.pressures, o.moment, tip_force, 1.0, elements, o.at);
  return o.at.modes == 0;
}

}  // namespace contid
