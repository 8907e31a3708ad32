// Search for a loaded arm among the poses on its branch alone, after a descent from the last command did not end on the
// target and on the branch.
//
//     minimise  |r(P)|   over the pressures P in their limits whose path from rest is stable (branch.hpp)
//
// Bounded least squares has many local minima there, and most descents of an unreachable target end at corners of the
// box or where the arm would snap. Descents (descent.hpp) start from the present state, from the unloaded closed form,
// and from points next to the corners of the box, nearest to the target first by a coarse look at all of them. Short
// descents of many starts are followed by longer ones of the best, by points around the best, and by poses beside the
// answers on the target to which no straight path leads (beside.hpp). It stops at the first answer on the target that
// the arm reaches on a straight path (straight_path.hpp) and with which twice the elements agree, or when the work of
// `Effort` is done.
#pragma once

#include "../closed_form.hpp"
#include "../discretisation.hpp"
#include "beside.hpp"
#include "effort.hpp"

namespace contid {

constexpr int kCorners = 64, kTryWork = 60, kCandidates = 12, kRefusalElements = 12;
constexpr int kLookShare = 4, kLookSteps = 4, kLookCorrections = 4;
// Corner starts lie up to these parts of the range inside the box; the nearer ones count where the tip is this part of
// the reach away from those of the others.
constexpr double kInset = 0.06, kNearInset = 2e-3, kSwings = 0.1, kTracking = 0.05;
constexpr double kTryGain = 1e-2, kTryAhead = 8.0, kTryTrust = 1e-2, kTryRoom = 1e-2;
// Dropped answers that are less apart are one [bar].
constexpr double kDroppedApart = 0.2;

struct Found {
  Outcome outcome;
  bool stable;
  int elements, iterations;
  double snap = kNoSnap;  // on the path to an equilibrium on the target: see snap_on_path
};

// True where an answer is next to the last command of an arm in motion; one at its lower limits is at rest.
inline bool continues(const Limits& limits, const Outcome& o, const double* seed) {
  bool rests = true;
  for (int i = 0; i < limits.count; ++i) rests = rests && seed[i] <= limits.lower[i];
  return !rests && most_change(limits.count, o.pressures, seed) <= kTracking;
}

// Search for a loaded arm where a descent from the last command did not end on the target and on the branch: from
// several starts, only through equilibria of the branch that the present state reaches on a straight path. Short
// descents of many starts, longer ones of the best of them.
struct BranchSearch {
  static constexpr int kStarts = kSets * kCorners + 1;
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  int elements;
  double tolerance;
  const Effort& effort;
  const int n = rod.pressures(), corners = n < 6 ? 1 << n : kCorners;
  int work = 0;  // about the number of steps that descents could have made; bounds the time
  bool over = false;
  double snap = kNoSnap;
  BranchPose present{}, candidates[kCandidates]{};  // nearest to the target first
  double errors[kCandidates]{};
  int count = 0;
  double dropped[kDropped][kMost] = {};  // answers on the target to which no straight path leads
  int drops = 0;
  Nearest<StraightPose, kDropped * kStraights> straight{};  // poses beside those to which one does
  Found best{};

  // False where no equilibrium of the branch has the pressures of a pose.
  bool pose_at(BranchPose& pose) {
    const double done = ramped(rod, pose.pressures, force, elements, pose.moment, pose.at, pose.ramp);
    work += pose.ramp.work();
    return done == 1.0;
  }

  // True when twice the elements agree with an outcome; too few bend the branch where it is steep.
  bool agrees_with_finer(const Outcome& o) {
    Vec moment;
    Judged at;
    work += 2 * kRampWork;
    return equilibrium(rod, o.pressures, force, 2 * elements, moment, at) == 1.0 &&
           task_error(task, at.ends) <= o.residual + kFine;
  }

  // Adds the end of a descent to the best, in place of a worse one next to it.
  void add(const BranchPose& pose, double residual) {
    int at = 0;
    for (; at < count; ++at) {
      if (most_change(n, pose.pressures, candidates[at].pressures) > kTracking) continue;
      if (!(residual < errors[at])) return;
      break;
    }
    if (at == count && count < kCandidates) ++count;
    if (at == kCandidates && !(residual < errors[--at])) return;
    for (; at > 0 && residual < errors[at - 1]; --at) candidates[at] = candidates[at - 1], errors[at] = errors[at - 1];
    candidates[at] = pose, errors[at] = residual;
  }

  void drop(const Outcome& o) {
    for (int k = 0; k < drops; ++k)
      if (most_change(n, o.pressures, dropped[k]) <= kDroppedApart) return;
    if (drops < effort.beside) std::copy(o.pressures, o.pressures + n, dropped[drops++]);
  }

  // Descends from points around a pose, those nearest to the target first: paths through the forks around it end on
  // several sides of them.
  void around(const BranchPose& centre) {
    Nearest<BranchPose, kProbeDescents> starts;
    over_probes(limits, centre.pressures, kWide, [&](BranchPose& probe) {
      if (pose_at(probe)) starts.add(probe, task_error(task, probe.at.ends));
    });
    for (int k = 0; k < starts.count && !over; ++k) attempt(starts.each[k], kTryWork);
  }

  // Searches beside an answer that was dropped; the search is over on the target.
  void beside(const double* pressures) {
    const StopRule stop{kTryWork, kTryGain, 0.0, 0.0, kTryTrust, kTryRoom};
    Beside near{rod, task, force, limits, elements, tolerance, present, stop};
    near.run(pressures);
    work += near.work;
    for (int k = 0; k < near.found.count; ++k) straight.add(near.found.each[k], near.found.errors[k]);
    if (!near.met()) return;
    const Outcome o = outcome_of(task, near.found.each[0].pose, tolerance);
    if (agrees_with_finer(o)) best.outcome = o, over = true;
  }

  // Descends from a pose; the search is over on the target.
  void attempt(const BranchPose& start, int most) {
    Descent descent{rod, task, force, limits, elements, tolerance};
    const Outcome o =
        descent.run(start, {most, kTryGain, count ? errors[0] : 0.0, count ? kTryAhead : 0.0, kTryTrust, kTryRoom});
    work += o.iterations;
    if (count == kCandidates && !(o.residual < errors[kCandidates - 1])) return;
    if (at_target(o)) {
      work += kRampWork;
      const double leaves = snap_on_path(rod, force, present.pressures, present.moment, o, elements);
      snap = std::fmin(snap, leaves);
      if (leaves < kNoSnap) return drop(o);
    }
    if (o.met && !agrees_with_finer(o)) return;
    if (o.met) best.outcome = o, over = true;
    add(descent.pose(), o.residual);
  }

  // The corner next to which a point is; the one between the first two sets is the centre.
  int corner_of(int index) const { return index > corners ? (index - 1) % corners : index; }

  // Points next to the corners of the box, off planes of symmetry, where paths fork; its centre; points on other sides
  // of those planes; then both nearer to the corners, for arms that swing far there.
  void point(int index, double* p) const {
    const int set = index > corners ? (index - 1) / corners : 0, corner = corner_of(index);
    const bool mirrored = set % 2 == 1;
    const double most = set < 2 ? kInset : kNearInset;
    for (int i = 0; i < n; ++i) {
      const double range = limits.upper[i] - limits.lower[i];
      if (index == corners) {
        p[i] = limits.centre[i];
        continue;
      }
      const double share = radical_inverse(corner + 1, kPrimes[i]);
      const double inset = most * (mirrored ? 1.0 - share : share) * range;
      const bool high = n <= 6 ? (corner >> i) & 1 : share >= 0.5;
      p[i] = high ? limits.upper[i] - inset : limits.lower[i] + inset;
    }
  }

  // About where the arm is with the pressures of a pose: in few steps from rest, stable or not.
  bool roughly_at(BranchPose& pose) const {
    const double enough = kRough * load_scale(rod, force);
    double p[kMost];
    Vec last{}, before{};
    for (int k = 1; k <= kLookSteps; ++k) {
      const double part = static_cast<double>(k) / kLookSteps;
      for (int j = 0; j < n; ++j) p[j] = part * pose.pressures[j];
      Vec moment = k == 1 ? predicted_moment(rod, {0, 0, rod.reach}, part * force, part) : 2.0 * last - before;
      bool near = false;
      for (int i = 0; i < kLookCorrections && !near; ++i) {
        judge(rod, p, moment, part * force, part, effort.look_elements, pose.at);
        near = norm(pose.at.ends.moment) <= enough;
        if (!pose.at.regular) return false;
        moment = moment - pose.at.moment_by_balance * pose.at.ends.moment;
      }
      if (!near) return false;
      before = last, last = moment;
    }
    return true;
  }

  // Starts nearest to the target first, by a coarse look at all: in few steps, or by a path where these do not get
  // there.
  void elsewhere(int most) {
    double away[kStarts];
    Vec tips[kStarts];
    bool stands[kStarts] = {};
    int order[kStarts], seen = 0, spare = most;
    const int looks = std::min(effort.sets * corners + 1, most / kLookShare);
    for (int index = 0; index < looks; ++index) {
      BranchPose coarse;
      point(index, coarse.pressures);
      if (!roughly_at(coarse) || coarse.at.modes != 0) {
        if (spare <= 0) continue;
        const double done =
            ramped(rod, coarse.pressures, force, effort.look_elements, coarse.moment, coarse.at, coarse.ramp);
        spare -= coarse.ramp.work();
        if (done < 1.0) continue;
      }
      stands[index] = true, tips[index] = coarse.at.ends.p;
      const auto same = [&](int other) {
        return stands[other] && norm(tips[other] - tips[index]) < kSwings * rod.reach;
      };
      const int corner = corner_of(index);
      if (index > 2 * corners && (same(corner) || same(corner + corners + 1))) continue;
      away[seen] = task_error(task, coarse.at.ends);
      int at = seen++;
      for (; at > 0 && away[at - 1] > away[at]; --at) std::swap(away[at - 1], away[at]), order[at] = order[at - 1];
      order[at] = index;
    }
    work += looks;
    for (int k = 0; k < seen && work < most && !over; ++k) {
      BranchPose start;
      point(order[k], start.pressures);
      if (pose_at(start)) attempt(start, kTryWork);
    }
  }

  // False when the branch has no pose at the seed: the arm is left alone.
  bool run(const double* seed) {
    std::copy(seed, seed + n, present.pressures);
    clamp(limits, present.pressures);
    if (!pose_at(present)) return false;
    attempt(present, kTryWork);
    BranchPose start;
    if (!over && unloaded(rod, task, limits, start.pressures) && pose_at(start)) attempt(start, kTryWork);
    if (!over) elsewhere(steps_for(rod.count, effort.work, elements));
    for (int k = 0; k < effort.longer && k < count && !over; ++k) {
      const BranchPose from = candidates[k];
      attempt(from, effort.long_work);
    }
    if (effort.around && !over) {
      const BranchPose centre = candidates[0];
      around(centre);
    }
    for (int k = 0; k < drops && !over; ++k) beside(dropped[k]);
    if (!over) best.outcome = outcome_of(task, candidates[0], tolerance);
    best.stable = true;
    best.snap = over ? kNoSnap : snap;
    best.elements = elements;
    best.iterations = work;
    return true;
  }
};

}  // namespace contid
