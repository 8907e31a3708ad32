// The last descents of answers out of reach: from the candidates of a branch search, nearest to the target first, with
// the elements they need.
//
//     minimise  |r(P)|   over the pressures P in their limits whose path from rest is stable
//
// An answer counts only where twice the elements agree with it, and, next to the target, where the arm gets there on a
// straight path; otherwise poses on the way back to the start of its descent are tried. An answer is never farther from
// the target than where the arm stands. The best one is descended from once more until no step helps. It stops when the
// work of `Effort` is done.
#pragma once

#include <limits>

#include "branch_search.hpp"

namespace contid {

constexpr double kRetreat = 2e-3;
constexpr int kLeastWork = 12, kFinishWork = 40;
constexpr double kLastGain = 1e-3, kLastTrust = 1e-5, kLastAhead = 8.0, kCertain = 3.0;

// The pose on the branch with the pressures of an answer; where more elements have none, one next to it, towards the
// seed.
inline bool pose_near(const Rod& rod, Vec force, const Limits& limits, const double* seed, const double* pressures,
                      int elements, BranchPose& pose) {
  for (double part = 0.0; part < 1.0; part = part > 0.0 ? 4.0 * part : kRetreat) {
    for (int i = 0; i < rod.pressures(); ++i) pose.pressures[i] = pressures[i] + part * (seed[i] - pressures[i]);
    clamp(limits, pose.pressures);
    if (ramped(rod, pose.pressures, force, elements, pose.moment, pose.at, pose.ramp) == 1.0) return true;
  }
  return false;
}

// How far from the target the arm stands, and a tolerance for its elements; infinite where they find no pose.
inline double standing_error(const Rod& rod, const Task& task, Vec force, const Limits& limits, const double* seed,
                             const Settings& settings) {
  double here[kMost];
  Vec moment;
  Judged at;
  const bool stands = standing(rod, force, limits, seed, settings.elements, here, moment, at);
  return stands ? task_error(task, at.ends) + settings.error : std::numeric_limits<double>::infinity();
}

// Descends from the candidates of a search with the elements that they need.
struct LastDescents {
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  const double* seed;
  const Settings& settings;
  int cost_left;
  int spent = 0;
  bool any = false, stays = false;  // stays: the best one, to which a straight path leads, is left where it is
  double snap = kNoSnap;
  Found best{};

  bool is_fine(const Outcome& o, int count) const {
    return contid::is_fine(rod, o.pressures, o.moment, o.at, force, count, settings.error);
  }

  // True where `forward` has the tip of an outcome, and a path with twice the elements too: next to the boundary the
  // elements decide on which side the arm is.
  bool is_certain(const Outcome& o, int count, bool straight) {
    Vec moment;
    Judged at;
    int elements;
    spend(2 * kRampWork, 2 * count);
    if (straight || at_target(o)) {
      const double leaves = snap_from(rod, force, limits, seed, o, count);
      snap = std::fmin(snap, leaves);
      if (leaves < kNoSnap) return false;
    }
    return fine_equilibrium(rod, o.pressures, force, settings, moment, at, elements) == 1.0 &&
           norm(at.ends.p - o.at.ends.p) <= settings.error &&
           equilibrium(rod, o.pressures, force, 2 * count, moment, at) == 1.0 &&
           norm(at.ends.p - o.at.ends.p) <= kCertain * settings.error;
  }

  void spend(int steps, int elements) { spent += steps, cost_left -= cost_of(rod.count, steps, elements); }

  // Takes a pose with given pressures, or the end of a descent from it, or one on the way back from there, if that is
  // better than the best.
  void attempt(const double* pressures, int elements, bool descends, const double* behind = nullptr) {
    Found found{};
    found.elements = elements, found.stable = true;
    Outcome& o = found.outcome;
    std::copy(pressures, pressures + rod.pressures(), o.pressures);
    for (;; found.elements *= 2) {
      BranchPose pose;
      if (!pose_near(rod, force, limits, seed, o.pressures, found.elements, pose)) return;
      spend(pose.ramp.work(), found.elements);
      o = outcome_of(task, pose, settings.tolerance);
      if (!is_fine(o, found.elements)) continue;
      if (!descends) break;
      const StopRule stop{std::max(steps_for(rod.count, cost_left, found.elements), kLeastWork), kLastGain,
                          best.outcome.residual, any ? kLastAhead : 0.0, kLastTrust};
      o = descend(rod, task, force, limits, pose, found.elements, settings.tolerance, stop);
      spend(o.iterations, found.elements);
      if (is_fine(o, found.elements)) break;
    }
    const Outcome end = o;
    const bool straight = behind || at_target(end);
    for (double part = 0.0; part < 1.0; part = part > 0.0 ? 4.0 * part : kRetreat) {
      if (part > 0.0) {
        BranchPose pose;
        const double* back = behind ? behind : pressures;
        for (int i = 0; i < rod.pressures(); ++i)
          pose.pressures[i] = end.pressures[i] + part * (back[i] - end.pressures[i]);
        spend(kRampWork, found.elements);
        if (ramped(rod, pose.pressures, force, found.elements, pose.moment, pose.at, pose.ramp) < 1.0) continue;
        o = outcome_of(task, pose, settings.tolerance);
      }
      if (any && !(o.residual < best.outcome.residual)) return;
      if (!is_fine(o, found.elements) || !is_certain(o, found.elements, straight)) continue;
      best = found, any = true, stays = behind || (straight && part > 0.0);
      return;
    }
  }

  // An answer is never farther from the target than where the arm stands, which may need more elements than the search.
  void stay() {
    Found here{};
    BranchPose pose;
    std::copy(seed, seed + rod.pressures(), pose.pressures);
    clamp(limits, pose.pressures);
    const double done = fine_equilibrium(rod, pose.pressures, force, settings, pose.moment, pose.at, here.elements);
    spend(kRampWork, here.elements);
    if (done < 1.0) return;
    here.outcome = outcome_of(task, pose, settings.tolerance), here.stable = true;
    if (!any || here.outcome.residual < best.outcome.residual) best = here, any = true, stays = false;
  }

  // Goes on from the best one until no step helps: only then it is known to be an optimum.
  void finish() {
    BranchPose pose;
    std::copy(best.outcome.pressures, best.outcome.pressures + rod.pressures(), pose.pressures);
    if (ramped(rod, pose.pressures, force, best.elements, pose.moment, pose.at, pose.ramp) < 1.0) return;
    Outcome o = descend(rod, task, force, limits, pose, best.elements, settings.tolerance,
                        {std::max(steps_for(rod.count, kFinishWork, best.elements), kLeastWork)});
    spend(pose.ramp.work() + o.iterations, best.elements);
    if (o.residual <= best.outcome.residual && is_fine(o, best.elements) && is_certain(o, best.elements, false))
      best.outcome = o;
  }

  // False where no outcome of a search counts.
  bool run(const BranchSearch& search) {
    for (int k = 0; k < search.count && cost_left > 0; ++k)
      attempt(search.candidates[k].pressures, search.elements, true);
    for (int k = 0; k < search.count && !any; ++k) attempt(search.candidates[k].pressures, search.elements, false);
    for (int k = 0; k < search.straight.count; ++k)
      attempt(search.straight.each[k].pose.pressures, search.elements, false, search.straight.each[k].behind);
    stay();
    if (any && !stays && !best.outcome.optimal) finish();
    best.snap = std::fmin(snap, search.snap);
    best.iterations = spent;
    return any;
  }
};

}  // namespace contid
