// Descents along the branch from several starts: twin of contid/kinematics/cosserat/branch_search.py.
#pragma once

#include "../halton.hpp"
#include "closed_form.hpp"
#include "descent.hpp"

namespace contid {

constexpr int kRestarts = 20, kCorners = 64, kWork = 280, kTryWork = 40, kRefusalElements = 12;
constexpr int kLookElements = 2, kLookShare = 4;
// Corner starts lie up to this part of the range inside the box.
constexpr double kInset = 0.06, kTracking = 0.05;
constexpr double kFine = 1.0;  // [mm]
constexpr double kTryGain = 1e-2, kTryAhead = 8.0, kTryTrust = 1e-2;

// Work that a search elsewhere may take: the cost of a step grows with elements and sections.
template <int K> constexpr int allowed_work(int elements) { return 6 * kWork / (elements * K); }

template <int K> struct Found {
  Outcome<K> outcome;
  bool stable;
  int elements, iterations;
  double snap;  // part of the path to an equilibrium on the target at which the arm snaps through; 1 for none
};

// An outcome that is a pose on the branch.
template <int K> Outcome<K> outcome_of(const Task& task, const BranchPose<K>& pose, double tolerance) {
  Outcome<K> o{};
  double r[9], sum = 0.0;
  residual(task, pose.at.ends, r);
  for (int a = 0; a < task.rows(); ++a) sum += r[a] * r[a];
  std::copy(pose.pressures, pose.pressures + 3 * K, o.pressures);
  o.moment = pose.moment, o.at = pose.at;
  o.residual = std::sqrt(sum), o.statics = norm(pose.at.ends.moment);
  o.met = o.optimal = o.residual <= tolerance;
  o.blocked = !o.met;
  return o;
}

// True where an answer is next to the last command of an arm in motion; one at its lower limits is at rest.
template <int K> bool continues(const Limits<K>& limits, const Outcome<K>& o, const double* seed) {
  bool rests = true;
  double most = 0.0;
  for (int i = 0; i < 3 * K; ++i) {
    rests = rests && seed[i] <= limits.lower[i];
    most = std::fmax(most, std::fabs(o.pressures[i] - seed[i]));
  }
  return !rests && most <= kTracking;
}

// Search for a loaded arm where a descent from the last command did not end on the target and on the branch: from
// several starts, only through equilibria of the branch that the present state reaches on a straight path.
template <int K> struct BranchSearch {
  static constexpr int n = 3 * K, kCornerStarts = n < 6 ? 1 << n : kCorners, kStarts = kCornerStarts + 1;
  const Rod<K>& rod;
  const Task& task;
  Vec force;
  const Limits<K>& limits;
  int elements;
  double tolerance;
  int work = 0;  // about the number of steps that descents could have made; bounds the time
  bool any = false;
  double snap = 1.0;
  BranchPose<K> present{};
  Found<K> best{};

  // False where no equilibrium of the branch has the pressures of a pose.
  bool pose_at(BranchPose<K>& pose) {
    work += kRampWork;
    return ramped<K>(rod, pose.pressures, force, elements, pose.moment, pose.at, pose.ramp) == 1.0;
  }

  bool same(Vec moment, Vec other) const { return norm(moment - other) <= kSamePose * load_scale<K>(rod, force); }

  double error(const Judged& at) const {
    double r[9], sum = 0.0;
    residual(task, at.ends, r);
    for (int a = 0; a < task.rows(); ++a) sum += r[a] * r[a];
    return std::sqrt(sum);
  }

  // True when the arm gets from the present state to an equilibrium; else `done` is the part of the path.
  bool reaches(const Outcome<K>& o, double& done) {
    Vec moment = present.moment;
    Judged at;
    work += kRampWork;
    done = follow<K>(rod, {present.pressures, force, 1.0}, {o.pressures, force, 1.0}, elements, moment, at);
    return done == 1.0 && same(moment, o.moment);
  }

  // True when twice the elements agree with an outcome; too few bend the branch where it is steep.
  bool agrees_with_finer(const Outcome<K>& o) {
    Vec moment;
    Judged at;
    work += 2 * kRampWork;
    return equilibrium<K>(rod, o.pressures, force, 2 * elements, moment, at) == 1.0 && error(at) <= o.residual + kFine;
  }

  // A descent; it ends on the branch.
  Outcome<K> descended(const BranchPose<K>& start, const StopRule& stop) {
    Outcome<K> o = descend<K>(rod, task, force, limits, start, elements, tolerance, stop);
    work += o.iterations;
    if (any && !(o.residual < best.outcome.residual)) return o;
    BranchPose<K> end;
    std::copy(o.pressures, o.pressures + n, end.pressures);
    if (pose_at(end) && same(end.moment, o.moment) && agrees_with_finer(o)) return o;
    return outcome_of<K>(task, start, tolerance);
  }

  // Descends from one start; true when the search is over.
  bool attempt(const BranchPose<K>& start, bool here) {
    const StopRule stop =
        any ? StopRule{kTryWork, kTryGain, best.outcome.residual, kTryAhead, kTryTrust} : StopRule{kTryWork};
    const Outcome<K> o = descended(start, stop);
    if (any && !(o.residual < best.outcome.residual)) return false;
    double done = 1.0;
    if (o.met && !here && !reaches(o, done)) {
      snap = std::fmin(snap, done);
      return false;
    }
    any = true;
    best.outcome = o;
    return o.met;
  }

  // Points next to the corners of the box, off planes of symmetry, where ways fork; then its centre.
  void point(int index, double* p) const {
    for (int i = 0; i < n; ++i) {
      const double range = limits.upper[i] - limits.lower[i];
      if (index < kCornerStarts) {
        const double inset = kInset * radical_inverse(index + 1, kPrimes[i]) * range;
        const bool high = n <= 6 ? (index >> i) & 1 : radical_inverse(index + 1, kPrimes[i]) >= 0.5;
        p[i] = high ? limits.upper[i] - inset : limits.lower[i] + inset;
      } else {
        p[i] = limits.centre[i];
      }
    }
  }

  // Starts nearest to the target first, by a coarse look at all.
  bool elsewhere(int most) {
    double away[kStarts];
    int order[kStarts], count = 0;
    const int looks = std::min(kStarts, (most - work) / kLookShare);
    for (int index = 0; index < looks; ++index) {
      BranchPose<K> coarse;
      point(index, coarse.pressures);
      ++work;
      if (equilibrium<K>(rod, coarse.pressures, force, kLookElements, coarse.moment, coarse.at) < 1.0) continue;
      away[count] = error(coarse.at);
      int at = count++;
      for (; at > 0 && away[at - 1] > away[at]; --at) std::swap(away[at - 1], away[at]), order[at] = order[at - 1];
      order[at] = index;
    }
    for (int k = 0; k < count && work < most; ++k) {
      BranchPose<K> start;
      point(order[k], start.pressures);
      if (pose_at(start) && attempt(start, false)) return true;
    }
    return false;
  }

  // False when the branch has no pose at the seed: the arm is left alone.
  bool run(const double* seed) {
    std::copy(seed, seed + n, present.pressures);
    clamp<K>(limits, present.pressures);
    if (!pose_at(present)) return false;
    bool over = attempt(present, true);
    BranchPose<K> start;
    if (!over && unloaded<K>(rod, task, limits, start.pressures) && pose_at(start)) over = attempt(start, false);
    if (!over) over = elsewhere(work + allowed_work<K>(elements));
    best.stable = true;
    best.snap = best.outcome.met ? 1.0 : snap;
    best.elements = elements;
    best.iterations = work;
    return true;
  }
};

}  // namespace contid
