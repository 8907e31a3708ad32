// Where solves start: twin of contid/kinematics/cosserat/{closed_form,search}.py.
#pragma once

#include "branch_search.hpp"
#include "last_descents.hpp"
#include "track.hpp"
#include "track_home.hpp"

namespace contid {

constexpr int kIterations = 60, kRestartIterations = 25, kLoadSteps = 3, kRampIterations = 10;
constexpr int kFinerIterations = 6;
constexpr double kRampTolerance = 1e-2;

// True when the arm gets from the seed to an equilibrium on a straight path, or has none at the seed.
template <int K>
bool reached_from(const Rod<K>& rod, Vec tip_force, const Limits<K>& limits, const double* seed, const Outcome<K>& o,
                  int elements) {
  double from[3 * K];
  std::copy(seed, seed + 3 * K, from);
  clamp<K>(limits, from);
  Vec moment;
  Judged at;
  if (equilibrium<K>(rod, from, tip_force, elements, moment, at) < 1.0) return true;
  return follow<K>(rod, {from, tip_force, 1.0}, {o.pressures, tip_force, 1.0}, elements, moment, at) == 1.0 &&
         norm(moment - o.moment) <= kSamePose * load_scale<K>(rod, tip_force);
}

template <int K>
Found<K> search(const Rod<K>& rod, const Task& task, Vec tip_force, const Limits<K>& limits, const double* seed,
                const Settings& settings) {
  constexpr int n = 3 * K;
  const bool weighs = loaded<K>(rod, tip_force);
  const bool light = massless<K>(rod, 1.0);
  const double scale = load_scale<K>(rod, tip_force);
  const Vec guess = predicted_moment<K>(rod, task.tip, tip_force, 1.0);
  Found<K> best{};
  best.snap = 1.0;
  bool any = false;
  int spent = 0;
  const auto stable = [&](Outcome<K>& o, int count) {
    if (o.statics > kBalance) return false;
    if (!weighs) return true;
    if (o.at.modes < 0) judge<K>(rod, o.pressures, o.moment, tip_force, 1.0, count, o.at);
    return o.at.modes == 0;
  };
  const auto moved = [&](const Outcome<K>& o, const double* from) {
    double most = 0.0;
    for (int i = 0; i < n; ++i) most = std::fmax(most, std::fabs(o.pressures[i] - from[i]));
    return most;
  };
  // True when an equilibrium is the one that counts, and the arm gets there from the seed.
  const auto is_on_branch = [&](const Outcome<K>& o) {
    if (!weighs) return true;
    if (moved(o, seed) <= kTracking) return on_branch<K>(rod, o.pressures, o.moment, tip_force, settings.elements);
    Vec moment;
    Judged at;
    if (equilibrium<K>(rod, o.pressures, tip_force, settings.elements, moment, at) < 1.0 ||
        norm(moment - o.moment) > kSamePose * scale)
      return false;
    return reached_from<K>(rod, tip_force, limits, seed, o, settings.elements);
  };
  // Moves an answer to a redundant task to the nearest to the centre, where that is one that counts.
  const auto home = [&](Found<K>& found) {
    if (!found.outcome.met || task.independent() >= n) return false;
    Outcome<K> o = found.outcome;
    o.iterations += Homing<K>{rod, task, tip_force, limits, found.elements}.run(o);
    found.outcome.iterations = o.iterations;
    if (!stable(o, found.elements) || !is_on_branch(o)) return false;
    found.outcome = o;
    return true;
  };
  // The nearest to the centre next to the last command.
  const auto tracked_home = [&](Outcome<K>& o) {
    const Homing<K> homing{rod, task, tip_force, limits, settings.elements};
    const bool met = track_home<K>(homing, seed, guess, settings.tolerance, kTracking, o);
    return met && stable(o, settings.elements) && is_on_branch(o);
  };
  const auto attempt = [&](const double* start, int iterations) {
    Found<K> found{};
    found.snap = 1.0;
    found.elements = settings.elements;
    const bool redundant = task.independent() < n;
    bool homed = start == seed && redundant && tracked_home(found.outcome);
    // Without load the strains are constant, and one element is exact.
    if (!homed && !(start == seed && light &&
                    track<K>(rod, task, tip_force, limits, start, weighs ? settings.elements : 1, settings.tolerance,
                             found.outcome)))
      found.outcome =
          solve<K>(rod, task, tip_force, 1.0, limits, start, guess, settings.elements, settings.tolerance, iterations);
    homed = homed || home(found);
    found.stable = homed || stable(found.outcome, settings.elements);
    spent += found.outcome.iterations;
    const bool usable = found.outcome.met || (found.outcome.optimal && start == seed);
    const bool counts = homed || (found.stable && usable && is_on_branch(found.outcome));
    if (weighs && !counts) return false;
    if (!any || (found.outcome.met && !best.outcome.met) ||
        (found.outcome.met == best.outcome.met && found.outcome.residual < best.outcome.residual))
      best = found;
    any = true;
    return found.outcome.met && found.stable;
  };
  const auto everywhere = [&] {
    double start[n];
    if (unloaded<K>(rod, task, limits, start)) {
      for (int k = 1; weighs && k < kLoadSteps; ++k) {
        const double part = static_cast<double>(k) / kLoadSteps;
        const Outcome<K> rough = solve<K>(rod, task, part * tip_force, part, limits, start,
                                          predicted_moment<K>(rod, task.tip, part * tip_force, part), settings.elements,
                                          kRampTolerance, kRampIterations);
        std::copy(rough.pressures, rough.pressures + n, start);
      }
      if (attempt(start, kRestartIterations)) return true;
    }
    if (weighs) return false;
    std::copy(limits.centre, limits.centre + n, start);
    if (attempt(start, kRestartIterations)) return true;
    for (int index = 1; index <= kRestarts; ++index) {
      for (int i = 0; i < n; ++i)
        start[i] = limits.lower[i] + radical_inverse(index, kPrimes[i]) * (limits.upper[i] - limits.lower[i]);
      if (attempt(start, kRestartIterations)) return true;
    }
    return true;
  };
  // A bounded optimum next to the last command continues a motion; another start would only jump.
  const auto tracked = [&] { return any && best.outcome.optimal && continues<K>(limits, best.outcome, seed); };
  const Effort& effort = settings.thorough ? kThoroughEffort : kTickEffort;
  bool descended = false;
  if (!attempt(seed, kIterations) && !tracked() && !everywhere()) {
    for (int elements = settings.elements;; elements = kRefusalElements) {
      BranchSearch<K> branch{rod, task, tip_force, limits, elements, settings.tolerance, effort};
      descended = branch.run(seed);
      spent += branch.work;
      if (descended && !branch.over) {
        LastDescents<K> last{rod, task, tip_force, limits, seed, settings, effort.last_work};
        descended = last.run(branch);
        spent += last.spent;
        branch.best = last.best;
      }
      if (descended && any && !branch.best.outcome.met && best.outcome.residual <= branch.best.outcome.residual)
        best.snap = branch.best.snap, descended = false;
      else if (descended)
        best = branch.best;
      if (descended) home(best);
      if (descended || any || elements >= kRefusalElements) break;
    }
  }
  const auto on_branch_at = [&](int elements, const Outcome<K>& o) {
    Vec moment;
    Judged at;
    return equilibrium<K>(rod, o.pressures, tip_force, elements, moment, at) == 1.0 &&
           norm(moment - o.moment) <= kSamePose * scale;
  };
  const bool met = best.outcome.met;
  bool along = descended;  // the branch; what counts is the pose that the straight path from rest reaches
  while (weighs && best.stable && best.elements < kMaxElements) {
    const Outcome<K> o = best.outcome;
    if (discretisation_error<K>(rod, o.pressures, o.moment, o.at, tip_force, best.elements) <= settings.error) break;
    best.elements *= 2;
    if (o.met)
      best.outcome = solve<K>(rod, task, tip_force, 1.0, limits, o.pressures, o.moment, best.elements,
                              settings.tolerance, kIterations);
    // More elements can end the branch before the pressures that fewer of them reach.
    if (!o.met || !best.outcome.met || !stable(best.outcome, best.elements) ||
        moved(best.outcome, o.pressures) > kTracking || !on_branch_at(best.elements, best.outcome)) {
      BranchPose<K> pose;
      best.stable = pose_near<K>(rod, tip_force, limits, seed, o.pressures, best.elements, pose);
      if (best.stable) {
        best.outcome = descend<K>(rod, task, tip_force, limits, pose, best.elements, settings.tolerance,
                                  {o.met ? kRestartIterations : kFinerIterations});
        if (!on_branch_at(best.elements, best.outcome)) best.outcome = outcome_of<K>(task, pose, settings.tolerance);
      }
      along = true;
    }
    spent += best.outcome.iterations;
  }
  if (along && best.stable) {
    Outcome<K>& o = best.outcome;
    BranchPose<K> pose;
    best.stable = pose_near<K>(rod, tip_force, limits, seed, o.pressures, best.elements, pose);
    if (best.stable && (norm(pose.moment - o.moment) > kSamePose * scale || moved(o, pose.pressures) > 0.0))
      o = outcome_of<K>(task, pose, settings.tolerance);
  }
  if (along && best.stable && at_target(best.outcome))
    best.stable = reached_from<K>(rod, tip_force, limits, seed, best.outcome, best.elements);
  best.iterations = spent;
  const bool lost = met && !(best.stable && best.outcome.met);
  if (lost && best.elements > settings.elements && best.elements <= effort.again) {
    const Settings finer{best.elements, settings.tolerance, settings.error, settings.thorough};
    Found<K> again = search<K>(rod, task, tip_force, limits, seed, finer);
    again.iterations += spent;
    if (again.stable && (!best.stable || again.outcome.met || again.outcome.residual < best.outcome.residual))
      return again;
    best.iterations = again.iterations;
  }
  return best;
}

}  // namespace contid
