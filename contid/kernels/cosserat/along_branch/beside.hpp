// Poses beside an answer on the target to which the straight path from the present state does not lead.
//
// Such a path passes a fork and ends on its other side. The forks that straight paths from one point meet are surfaces
// in the space of pressures: around the answer there are points on both sides of them. 24 Halton points in a box around
// it are tried, then as many in a smaller box around the nearest pose found; descents start from the four nearest to
// the target among those that the arm gets to. A descent ends on the target, or is cut, by bisection, where the
// straight path no longer leads there.
#pragma once

#include "../../halton.hpp"
#include "descent.hpp"
#include "straight_path.hpp"

namespace contid {

constexpr int kProbes = 24, kProbeDescents = 4, kHalvings = 7, kStraights = 4;
// Half the width of the boxes of probes, as a part of the range of pressures.
constexpr double kWide = 0.13, kNarrow = 0.03;

// The first few by their errors, nearest to the target first.
template <class Each, int most> struct Nearest {
  Each each[most + 1]{};
  double errors[most + 1]{};
  int count = 0;

  void add(const Each& one, double error) {
    int at = count;
    for (; at > 0 && error < errors[at - 1]; --at) each[at] = each[at - 1], errors[at] = errors[at - 1];
    each[at] = one, errors[at] = error;
    count = std::min(count + 1, most);
  }
};

// Calls `visit` with a pose for each point around pressures.
template <class Visit> void over_probes(const Limits& limits, const double* around, double width, Visit&& visit) {
  for (int k = 0; k < kProbes; ++k) {
    BranchPose probe;
    for (int i = 0; i < limits.count; ++i) {
      const double range = limits.upper[i] - limits.lower[i];
      probe.pressures[i] = around[i] + width * (2.0 * radical_inverse(k + 1, kPrimes[i]) - 1.0) * range;
    }
    clamp(limits, probe.pressures);
    visit(probe);
  }
}

// A pose to which a straight path leads; one leads to the pressures behind it too.
struct StraightPose {
  BranchPose pose;
  double behind[kMost];
};

struct Beside {
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  int elements;
  double tolerance;
  const BranchPose& present;
  StopRule stop;
  int work = 0;
  const int n = rod.pressures();
  Nearest<StraightPose, kStraights> found{};

  bool met() const { return found.count > 0 && found.errors[0] <= tolerance; }

  // True where the arm gets to a pose on the branch with these pressures, on the straight path too.
  bool straight_at(BranchPose& pose) {
    const double done = ramped(rod, pose.pressures, force, elements, pose.moment, pose.at, pose.ramp);
    work += pose.ramp.work();
    return done == 1.0 && is_straight(pose);
  }

  bool is_straight(const BranchPose& pose) {
    work += kRampWork;
    const Outcome o = outcome_of(task, pose, tolerance);
    return snap_on_path(rod, force, present.pressures, present.moment, o, elements) == kNoSnap;
  }

  // From a pose towards the target; where the straight path does not lead to the end of a descent, to the last point
  // on the way there to which it does.
  void attempt(const BranchPose& start) {
    Descent descent{rod, task, force, limits, elements, tolerance};
    const Outcome o = descent.run(start, stop);
    work += o.iterations;
    StraightPose good{};
    good.pose = start;
    std::copy(start.pressures, start.pressures + n, good.behind);
    BranchPose trial = descent.pose();
    if (is_straight(trial)) {
      good.pose = trial;
    } else {
      double low = 0.0, high = 1.0;
      for (int k = 0; k < kHalvings; ++k) {
        const double part = 0.5 * (low + high);
        for (int i = 0; i < n; ++i)
          trial.pressures[i] = start.pressures[i] + part * (o.pressures[i] - start.pressures[i]);
        if (straight_at(trial) && task_error(task, trial.at.ends) < task_error(task, good.pose.at.ends))
          low = part, good.pose = trial;
        else
          high = part;
      }
    }
    found.add(good, task_error(task, good.pose.at.ends));
  }

  // Searches around pressures, then around the nearest pose found.
  void run(const double* pressures) {
    search(pressures, kWide);
    if (found.count == 0 || met()) return;
    const BranchPose centre = found.each[0].pose;
    search(centre.pressures, kNarrow);
  }

  void search(const double* around, double width) {
    Nearest<BranchPose, kProbeDescents> starts;
    over_probes(limits, around, width, [&](BranchPose& probe) {
      if (straight_at(probe)) starts.add(probe, task_error(task, probe.at.ends));
    });
    for (int k = 0; k < starts.count && !met(); ++k) attempt(starts.each[k]);
  }
};

}  // namespace contid
