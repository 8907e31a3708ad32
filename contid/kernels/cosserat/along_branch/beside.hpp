// Poses beside an answer on the target to which the straight path from the present state does not lead: twin of
// contid/kinematics/cosserat/along_branch/beside.py, its specification.
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
template <int K, class Visit>
void over_probes(const Limits<K>& limits, const double* around, double width, Visit&& visit) {
  for (int k = 0; k < kProbes; ++k) {
    BranchPose<K> probe;
    for (int i = 0; i < 3 * K; ++i) {
      const double range = limits.upper[i] - limits.lower[i];
      probe.pressures[i] = around[i] + width * (2.0 * radical_inverse(k + 1, kPrimes[i]) - 1.0) * range;
    }
    clamp<K>(limits, probe.pressures);
    visit(probe);
  }
}

// A pose to which a straight path leads; one leads to the pressures behind it too.
template <int K> struct StraightPose {
  BranchPose<K> pose;
  double behind[3 * K];
};

template <int K> struct Beside {
  static constexpr int n = 3 * K;
  const Rod<K>& rod;
  const Task& task;
  Vec force;
  const Limits<K>& limits;
  int elements;
  double tolerance;
  const BranchPose<K>& present;
  StopRule stop;
  int work = 0;
  Nearest<StraightPose<K>, kStraights> found{};

  bool met() const { return found.count > 0 && found.errors[0] <= tolerance; }

  // True where the arm gets to a pose on the branch with these pressures, on the straight path too.
  bool straight_at(BranchPose<K>& pose) {
    const double done = ramped<K>(rod, pose.pressures, force, elements, pose.moment, pose.at, pose.ramp);
    work += pose.ramp.work();
    return done == 1.0 && is_straight(pose);
  }

  bool is_straight(const BranchPose<K>& pose) {
    work += kRampWork;
    const Outcome<K> o = outcome_of<K>(task, pose, tolerance);
    return snap_on_path<K>(rod, force, present.pressures, present.moment, o, elements) == kNoSnap;
  }

  // From a pose towards the target; where the straight path does not lead to the end of a descent, to the last point
  // on the way there to which it does.
  void attempt(const BranchPose<K>& start) {
    Descent<K> descent{rod, task, force, limits, elements, tolerance};
    const Outcome<K> o = descent.run(start, stop);
    work += o.iterations;
    StraightPose<K> good{};
    good.pose = start;
    std::copy(start.pressures, start.pressures + n, good.behind);
    BranchPose<K> trial = descent.pose();
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
    const BranchPose<K> centre = found.each[0].pose;
    search(centre.pressures, kNarrow);
  }

  void search(const double* around, double width) {
    Nearest<BranchPose<K>, kProbeDescents> starts;
    over_probes<K>(limits, around, width, [&](BranchPose<K>& probe) {
      if (straight_at(probe)) starts.add(probe, task_error(task, probe.at.ends));
    });
    for (int k = 0; k < starts.count && !met(); ++k) attempt(starts.each[k]);
  }
};

}  // namespace contid
