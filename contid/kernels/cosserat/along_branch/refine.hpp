// More elements for an answer, where its estimated error demands them.
#pragma once

#include "last_descents.hpp"

namespace contid {

// Most steps of a solve from the last command, from another start, and of a refined answer that is off its target.
constexpr int kIterations = 60, kRestartIterations = 25, kFinerIterations = 6;

// `force`: on the tip [N]; `seed`: the pressures of the last command. What most answers do not need is not inlined: it
// would slow those down.
struct Refinement {
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  const double* seed;
  const Settings& settings;

  // Solves again with twice the elements. True where the answer is kept; else it is a pose along the branch, next to
  // the pressures of the one before, or `found` is not stable any more.
  [[gnu::noinline]] bool doubled(Found& found) const {
    const Outcome o = found.outcome;
    const int elements = found.elements *= 2;
    Outcome& finer = found.outcome;
    if (o.met)
      finer = solve(rod, task, force, 1.0, limits, o.pressures, o.moment, elements, settings.tolerance, kIterations);
    // More elements can end the branch before the pressures that fewer of them reach.
    const bool kept = o.met && finer.met && is_stable(rod, force, finer, elements) &&
                      most_change(rod.pressures(), finer.pressures, o.pressures) <= kTracking &&
                      holds(rod, force, finer, elements);
    BranchPose pose;
    if (!kept) found.stable = pose_near(rod, force, limits, seed, o.pressures, elements, pose);
    if (!kept && found.stable) {
      finer = descend(rod, task, force, limits, pose, elements, settings.tolerance,
                      {o.met ? kRestartIterations : kFinerIterations});
      if (!holds(rod, force, finer, elements)) finer = outcome_of(task, pose, settings.tolerance);
    }
    found.iterations += finer.iterations;
    return kept;
  }

  // The pose that counts for pressures found along the branch; on the target the arm must get there.
  [[gnu::noinline]] void settle_on_branch(Found& found) const {
    Outcome& o = found.outcome;
    BranchPose pose;
    found.stable = pose_near(rod, force, limits, seed, o.pressures, found.elements, pose);
    if (!found.stable) return;
    if (!same_pose(rod, force, pose.moment, o.moment) ||
        most_change(rod.pressures(), o.pressures, pose.pressures) > 0.0)
      o = outcome_of(task, pose, settings.tolerance);
    if (at_target(o)) found.stable = reached_from(rod, force, limits, seed, o, found.elements);
  }

  // Doubles the elements until the estimated error of tip and mid-point is small enough. After a descent `along` the
  // branch what counts is the pose that the straight path from rest reaches.
  void run(Found& found, bool along) const {
    while (found.stable) {
      const Outcome& o = found.outcome;
      if (is_fine(rod, o.pressures, o.moment, o.at, force, found.elements, settings.error)) break;
      along = !doubled(found) || along;
    }
    if (along && found.stable) settle_on_branch(found);
  }
};

}  // namespace contid
