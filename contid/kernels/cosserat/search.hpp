// Where solves start: twin of contid/kinematics/cosserat/{closed_form,search}.py.
#pragma once

#include "../halton.hpp"
#include "closed_form.hpp"
#include "descent.hpp"
#include "discretisation.hpp"
#include "home.hpp"
#include "track.hpp"

namespace contid {

constexpr int kIterations = 60, kRestarts = 20, kRestartIterations = 25, kLoadSteps = 3, kRampIterations = 10;
constexpr double kRampTolerance = 1e-2, kTracking = 0.05;
constexpr double kRetreat = 2e-3;
constexpr int kWork = 1200, kStandWork = 4, kRefusalElements = 12;

template <int K> struct Found {
  Outcome<K> outcome;
  bool stable;
  int elements, iterations;
  double snap;  // part of the path to an equilibrium on the target at which the arm snaps through; 1 for none
};

// Search for a loaded arm where a descent from the last command did not end on the target and on the branch: from
// several starts, only through equilibria of the branch that the present state reaches on a straight path.
template <int K> struct BranchSearch {
  static constexpr int n = 3 * K;
  const Rod<K>& rod;
  const Task& task;
  Vec force;
  const Limits<K>& limits;
  int elements;
  double tolerance;
  int work = 0;  // about the number of iterations a descent could have made; bounds the time
  bool standing = false, any = false;
  double seed[n] = {};
  Vec seed_moment = {0, 0, 0};
  double snap = 1.0;
  Found<K> best{};

  // True when the arm gets from the present state to an equilibrium; else `done` is the part of the path.
  bool reaches(const Outcome<K>& o, double& done) {
    done = 1.0;
    if (!standing) return true;
    Vec moment = seed_moment;
    Judged at;
    work += kStandWork;
    done = follow<K>(rod, {seed, force, 1.0}, {o.pressures, force, 1.0}, elements, moment, at);
    return done == 1.0 && norm(moment - o.moment) <= kSamePose * load_scale<K>(rod, force);
  }

  // Descends from one start; true when the search is over.
  bool attempt(const double* start, int iterations) {
    Vec moment;
    Judged at;
    work += kStandWork;
    if (equilibrium<K>(rod, start, force, elements, moment, at) < 1.0) return false;
    const bool present = !any && start == seed;
    if (present) standing = true, seed_moment = moment;
    const Vec start_moment = moment;
    Outcome<K> o = descend<K>(rod, task, force, limits, start, moment, at, elements, tolerance, iterations, false);
    work += o.iterations;
    if (any && !(o.residual < best.outcome.residual)) return false;
    Judged end;
    work += kStandWork;
    if (equilibrium<K>(rod, o.pressures, force, elements, moment, end) < 1.0 ||
        norm(moment - o.moment) > kSamePose * load_scale<K>(rod, force)) {
      // The descent has passed a fold of the branch.
      o = descend<K>(rod, task, force, limits, start, start_moment, at, elements, tolerance, iterations, true);
      work += kStandWork * o.iterations;
      if (any && !(o.residual < best.outcome.residual)) return false;
    }
    double done = 1.0;
    if (o.met && !present && !reaches(o, done)) {
      snap = std::fmin(snap, done);
      return false;
    }
    any = true;
    best.outcome = o;
    return o.met;
  }

  // False when the arm does not stand at the seed.
  bool run(const double* from) {
    std::copy(from, from + n, seed);
    clamp<K>(limits, seed);
    const int most = kWork / elements;
    bool over = attempt(seed, kRestartIterations);
    if (!standing) return false;  // left alone
    double start[n];
    if (!over && unloaded<K>(rod, task, limits, start)) over = attempt(start, kRestartIterations);
    for (int index = 0; !over && index <= kRestarts && work < most; ++index) {
      for (int i = 0; i < n; ++i)
        start[i] = index == 0
                       ? limits.centre[i]
                       : limits.lower[i] + radical_inverse(index, kPrimes[i]) * (limits.upper[i] - limits.lower[i]);
      over = attempt(start, kRestartIterations);
    }
    if (!over) polish();
    best.stable = true;
    best.snap = best.outcome.met ? 1.0 : snap;
    best.elements = elements;
    best.iterations = work;
    return true;
  }

  // The best outcome again with more iterations.
  void polish() {
    const Outcome<K> o = best.outcome;
    if (o.optimal) return;
    best.outcome =
        descend<K>(rod, task, force, limits, o.pressures, o.moment, o.at, elements, tolerance, kIterations, true);
    work += kStandWork * best.outcome.iterations;
  }
};

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
  const auto stands = [&](const Outcome<K>& o) {
    if (!weighs) return true;
    if (moved(o, seed) <= kTracking) return on_branch<K>(rod, o.pressures, o.moment, tip_force, settings.elements);
    Vec moment;
    Judged at;
    if (equilibrium<K>(rod, o.pressures, tip_force, settings.elements, moment, at) < 1.0 ||
        norm(moment - o.moment) > kSamePose * scale)
      return false;
    double from[n];
    std::copy(seed, seed + n, from);
    clamp<K>(limits, from);
    if (equilibrium<K>(rod, from, tip_force, settings.elements, moment, at) < 1.0) return true;
    return follow<K>(rod, {from, tip_force, 1.0}, {o.pressures, tip_force, 1.0}, settings.elements, moment, at) ==
               1.0 &&
           norm(moment - o.moment) <= kSamePose * scale;
  };
  // Moves an answer to a redundant task to the nearest to the centre, where that is one that counts.
  const auto home = [&](Found<K>& found) {
    if (!found.outcome.met || task.independent() >= n) return false;
    Outcome<K> o = found.outcome;
    o.iterations += Homing<K>{rod, task, tip_force, limits, found.elements}.run(o);
    found.outcome.iterations = o.iterations;
    if (!stable(o, found.elements) || !stands(o)) return false;
    found.outcome = o;
    return true;
  };
  const auto attempt = [&](const double* start, int iterations) {
    Found<K> found{};
    found.snap = 1.0;
    // Without load the strains are constant, and one element is exact.
    if (!(start == seed && light &&
          track<K>(rod, task, tip_force, limits, start, weighs ? settings.elements : 1, settings.tolerance,
                   found.outcome)))
      found.outcome =
          solve<K>(rod, task, tip_force, 1.0, limits, start, guess, settings.elements, settings.tolerance, iterations);
    found.elements = settings.elements;
    const bool homed = home(found);
    found.stable = homed || stable(found.outcome, settings.elements);
    spent += found.outcome.iterations;
    const bool usable = found.outcome.met || (found.outcome.optimal && start == seed);
    const bool counts = homed || (found.stable && usable && stands(found.outcome));
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
  const auto tracked = [&] { return any && best.outcome.optimal && moved(best.outcome, seed) <= kTracking; };
  bool descended = false;
  if (!attempt(seed, kIterations) && !tracked() && !everywhere()) {
    for (int elements = settings.elements;; elements = kRefusalElements) {
      BranchSearch<K> branch{rod, task, tip_force, limits, elements, settings.tolerance};
      descended = branch.run(seed);
      spent += branch.work;
      if (descended && any && !branch.best.outcome.met && best.outcome.residual <= branch.best.outcome.residual)
        best.snap = branch.best.snap, descended = false;
      else if (descended)
        best = branch.best;
      if (descended) home(best);
      if (descended || any || elements >= kRefusalElements) break;
    }
  }
  // Where more elements find an answer unstable: a pose next to it, towards the seed, that they do not.
  double last[n];
  const auto retreat = [&](int elements, const Outcome<K>& o, Vec& moment, Judged& at, bool& stands) {
    stands = false;
    for (double part = kRetreat; !stands && part < 1.0; part *= 4.0) {
      for (int i = 0; i < n; ++i) last[i] = o.pressures[i] + part * (seed[i] - o.pressures[i]);
      clamp<K>(limits, last);
      stands = equilibrium<K>(rod, last, tip_force, elements, moment, at) == 1.0;
    }
    return last;
  };
  while (weighs && best.stable && best.elements < kMaxElements) {
    const Outcome<K> o = best.outcome;
    if (discretisation_error<K>(rod, o.pressures, o.moment, o.at, tip_force, best.elements) <= settings.error) break;
    best.elements *= 2;
    if (o.met)
      best.outcome = solve<K>(rod, task, tip_force, 1.0, limits, o.pressures, o.moment, best.elements,
                              settings.tolerance, kIterations);
    if (!o.met || !best.outcome.met || !stable(best.outcome, best.elements) ||
        moved(best.outcome, o.pressures) > kTracking) {
      Vec moment = o.moment;
      Judged at;
      best.stable = equilibrium<K>(rod, o.pressures, tip_force, best.elements, moment, at) == 1.0;
      const double* from = best.stable ? o.pressures : retreat(best.elements, o, moment, at, best.stable);
      if (best.stable)
        best.outcome = descend<K>(rod, task, tip_force, limits, from, moment, at, best.elements, settings.tolerance,
                                  kRestartIterations, true);
    }
    spent += best.outcome.iterations;
  }
  if (descended && best.stable) {
    // The descent came along the branch; the pose that counts is that of the straight path from rest.
    Outcome<K>& o = best.outcome;
    Vec moment;
    Judged at;
    best.stable = equilibrium<K>(rod, o.pressures, tip_force, best.elements, moment, at) == 1.0;
    if (best.stable && norm(moment - o.moment) > kSamePose * scale) {
      double r[9];
      residual(task, at.ends, r);
      o.moment = moment, o.at = at, o.residual = 0.0;
      for (int a = 0; a < task.rows(); ++a) o.residual += r[a] * r[a];
      o.residual = std::sqrt(o.residual);
      o.met = o.optimal = o.residual <= settings.tolerance;
      o.blocked = !o.met;
    }
  }
  best.iterations = spent;
  return best;
}

}  // namespace contid
