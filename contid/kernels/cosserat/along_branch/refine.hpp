// More elements for an answer, where its estimated error demands them. Twin and specification:
// contid/kinematics/cosserat/along_branch/refine.py.
#pragma once

#include "last_descents.hpp"

namespace contid {

constexpr int kIterations = 60, kRestartIterations = 25, kFinerIterations = 6;

// What most answers do not need is not inlined: it would slow those down.
template <int K> struct Refinement {
  const Rod<K>& rod;
  const Task& task;
  Vec force;
  const Limits<K>& limits;
  const double* seed;
  const Settings& settings;

  // An answer with twice the elements; false where it was lost and is a pose along the branch.
  [[gnu::noinline]] bool doubled(Found<K>& found) const {
    const Outcome<K> o = found.outcome;
    const int elements = found.elements *= 2;
    Outcome<K>& finer = found.outcome;
    if (o.met)
      finer = solve<K>(rod, task, force, 1.0, limits, o.pressures, o.moment, elements, settings.tolerance, kIterations);
    // More elements can end the branch before the pressures that fewer of them reach.
    const bool kept = o.met && finer.met && is_stable<K>(rod, force, finer, elements) &&
                      most_change<K>(finer.pressures, o.pressures) <= kTracking &&
                      holds<K>(rod, force, finer, elements);
    BranchPose<K> pose;
    if (!kept) found.stable = pose_near<K>(rod, force, limits, seed, o.pressures, elements, pose);
    if (!kept && found.stable) {
      finer = descend<K>(rod, task, force, limits, pose, elements, settings.tolerance,
                         {o.met ? kRestartIterations : kFinerIterations});
      if (!holds<K>(rod, force, finer, elements)) finer = outcome_of<K>(task, pose, settings.tolerance);
    }
    found.iterations += finer.iterations;
    return kept;
  }

  // The pose that counts for pressures found along the branch; on the target the arm must get there.
  [[gnu::noinline]] void settle_on_branch(Found<K>& found) const {
    Outcome<K>& o = found.outcome;
    BranchPose<K> pose;
    found.stable = pose_near<K>(rod, force, limits, seed, o.pressures, found.elements, pose);
    if (!found.stable) return;
    if (!same_pose<K>(rod, force, pose.moment, o.moment) || most_change<K>(o.pressures, pose.pressures) > 0.0)
      o = outcome_of<K>(task, pose, settings.tolerance);
    if (at_target(o)) found.stable = reached_from<K>(rod, force, limits, seed, o, found.elements);
  }

  // Doubles the elements until the estimated error of tip and mid-point is small enough. After a descent `along` the
  // branch what counts is the pose that the straight path from rest reaches.
  void run(Found<K>& found, bool along) const {
    while (found.stable) {
      const Outcome<K>& o = found.outcome;
      if (is_fine<K>(rod, o.pressures, o.moment, o.at, force, found.elements, settings.error)) break;
      along = !doubled(found) || along;
    }
    if (along && found.stable) settle_on_branch(found);
  }
};

}  // namespace contid
