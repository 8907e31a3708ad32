// Where a solve for a target starts and which of its answers is taken.
//
//     minimise  |r(P)|   over the pressures P in their limits, the arm in equilibrium on its branch
//
// r is the task error (task.hpp); a rod under load has several equilibria for one P, and the one that counts is defined
// in branch.hpp. Bounded least squares has local minima, so descents (solve.hpp, home.hpp, track.hpp) start from
//
//   1. the last command;
//   2. the unloaded closed form (closed_form.hpp), to which the loads are brought in steps;
//   3. for a rod that carries nothing: the centre of the limits and a fixed list of Halton points.
//
// The first answer on the target and on the branch ends the search. An optimum next to the last command that is not
// farther from the target than where the arm stands continues a motion and ends it too. Where neither is found for a
// loaded arm, along_branch/branch_search.hpp searches among the poses on the branch alone. Elements are doubled at the
// end until the discretisation error is small enough (along_branch/refine.hpp).
#pragma once

#include "along_branch/refine.hpp"
#include "track.hpp"
#include "track_home.hpp"

namespace contid {

constexpr int kLoadSteps = 3, kRampIterations = 10;
constexpr double kRampTolerance = 1e-2;

// The best outcome of a search along the branch, first with few elements; false where there is none. Not inlined, as
// Refinement.
[[gnu::noinline]] inline bool search_along_branch(const Rod& rod, const Task& task, Vec tip_force, const Limits& limits,
                                                  const double* seed, const Settings& settings, int elements,
                                                  int& spent, Found& best) {
  const Effort& effort = effort_of(settings);
  BranchSearch branch{rod, task, tip_force, limits, elements, settings.tolerance, effort};
  bool found = branch.run(seed);
  spent += branch.work;
  best = branch.best;
  if (!found || branch.over) return found;
  LastDescents last{rod, task, tip_force, limits, seed, settings, effort.last_work};
  found = last.run(branch);
  spent += last.spent;
  best = last.best;
  return found;
}

inline Found search(const Rod& rod, const Task& task, Vec tip_force, const Limits& limits, const double* seed,
                    const Settings& settings) {
  const int n = rod.pressures();
  const bool weighs = loaded(rod, tip_force);
  const bool light = massless(rod, 1.0);
  const Vec guess = predicted_moment(rod, task.tip, tip_force, 1.0);
  Found best{};
  bool any = false;
  int spent = 0;
  // True when an equilibrium is the one that counts, and the arm gets there from the seed.
  const auto is_on_branch = [&](const Outcome& o) {
    if (!weighs) return true;
    if (most_change(n, o.pressures, seed) <= kTracking)
      return on_branch(rod, o.pressures, o.moment, tip_force, settings.elements);
    return holds(rod, tip_force, o, settings.elements) &&
           reached_from(rod, tip_force, limits, seed, o, settings.elements);
  };
  // Moves an answer to a redundant task to the nearest to the centre, where that is one that counts.
  const auto home = [&](Found& found) {
    if (!found.outcome.met || task.independent() >= n) return false;
    Outcome o = found.outcome;
    o.iterations += Homing{rod, task, tip_force, limits, found.elements}.run(o);
    found.outcome.iterations = o.iterations;
    if (!is_stable(rod, tip_force, o, found.elements) || !is_on_branch(o)) return false;
    found.outcome = o;
    return true;
  };
  // The nearest to the centre next to the last command.
  const auto tracked_home = [&](Outcome& o) {
    const Homing homing{rod, task, tip_force, limits, settings.elements};
    const bool met = light && !rod.moments ? track_home(0, homing, seed, guess, settings.tolerance, kTracking, o)
                                           : track_home(3, homing, seed, guess, settings.tolerance, kTracking, o);
    return met && is_stable(rod, tip_force, o, settings.elements) && is_on_branch(o);
  };
  const auto attempt = [&](const double* start, int iterations) {
    Found found{};
    found.elements = settings.elements;
    const bool redundant = task.independent() < n;
    bool homed = start == seed && redundant && tracked_home(found.outcome);
    // Without load the strains are constant, and one element is exact.
    if (!homed && !(start == seed && light &&
                    track(rod, task, tip_force, limits, start, weighs ? settings.elements : 1, settings.tolerance,
                          found.outcome)))
      found.outcome =
          solve(rod, task, tip_force, 1.0, limits, start, guess, settings.elements, settings.tolerance, iterations);
    homed = homed || home(found);
    found.stable = homed || is_stable(rod, tip_force, found.outcome, settings.elements);
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
    double start[kMost];
    if (unloaded(rod, task, limits, start)) {
      for (int k = 1; weighs && k < kLoadSteps; ++k) {
        const double part = static_cast<double>(k) / kLoadSteps;
        const Outcome rough = solve(rod, task, part * tip_force, part, limits, start,
                                    predicted_moment(rod, task.tip, part * tip_force, part), settings.elements,
                                    kRampTolerance, kRampIterations);
        std::copy(rough.pressures, rough.pressures + n, start);
      }
      if (attempt(start, kRestartIterations)) return true;
    }
    if (weighs) return false;
    std::copy(limits.centre, limits.centre + n, start);
    if (attempt(start, kRestartIterations)) return true;
    for (int index = 1; index <= effort_of(settings).restarts; ++index) {
      for (int i = 0; i < n; ++i)
        start[i] = limits.lower[i] + radical_inverse(index, kPrimes[i]) * (limits.upper[i] - limits.lower[i]);
      if (attempt(start, kRestartIterations)) return true;
    }
    return true;
  };
  // A bounded optimum next to the last command, and not farther than where the arm stands, continues a motion; another
  // start would only jump.
  const auto tracked = [&] {
    if (!any || !best.outcome.optimal || !continues(limits, best.outcome, seed)) return false;
    return !weighs || best.outcome.residual <= standing_error(rod, task, tip_force, limits, seed, settings);
  };
  bool descended = false;
  if (!attempt(seed, kIterations) && !tracked() && !everywhere()) {
    for (int elements = settings.elements;; elements = kRefusalElements) {
      Found found;
      const bool searched = search_along_branch(rod, task, tip_force, limits, seed, settings, elements, spent, found);
      if (searched && any && !found.outcome.met && best.outcome.residual <= found.outcome.residual)
        best.snap = found.snap;
      else if (searched)
        best = found, descended = true;
      if (descended) home(best);
      if (searched || elements >= kRefusalElements) break;
    }
  }
  best.iterations = spent;
  if (!weighs || !best.stable) return best;
  const bool met = best.outcome.met;
  Refinement{rod, task, tip_force, limits, seed, settings}.run(best, descended);
  const bool lost = met && !(best.stable && best.outcome.met);
  if (!lost || best.elements <= settings.elements || best.elements > effort_of(settings).again) return best;
  const Settings finer{best.elements, settings.tolerance, settings.error, settings.thorough};
  Found again = search(rod, task, tip_force, limits, seed, finer);
  const bool better = !best.stable || again.outcome.met || again.outcome.residual < best.outcome.residual;
  again.iterations = best.iterations += again.iterations;
  if (again.stable && better) return again;
  return best;
}

}  // namespace contid
