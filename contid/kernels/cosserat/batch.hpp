// Many rows of a pneumatic arm. Specification: contid/kinematics/batch/loop.py. Units: mm, N, bar.
#pragma once

#include "../batch.hpp"
#include "settled.hpp"
#include "unloaded.hpp"

namespace contid {

// What a row's field `limited_by` holds: see contid/kinematics/batch/pneumatic.py.
constexpr std::uint64_t kOptimal = 1, kStable = 2, kBlocked = 4, kSnaps = 8;

struct TaskRows {
  TargetRows targets;
  double length;
  bool full_rotation;

  Task task(std::size_t k) const {
    const auto vec = [](const double* a) { return Vec{a[0], a[1], a[2]}; };
    Task task{};
    task.tip = vec(targets.tip + 3 * k);
    task.length = length;
    if (targets.mid) task.has_mid = true, task.mid = vec(targets.mid + 3 * k);
    if (targets.direction) {
      task.has_direction = true;
      task.direction = vec(targets.direction + 3 * k);
      task.full_rotation = full_rotation;
      if (full_rotation) task.frame = tilt(task.direction);
    }
    return task;
  }
};

inline Vec load_of(const double* loads, std::size_t k) {
  return loads ? Vec{loads[3 * k], loads[3 * k + 1], loads[3 * k + 2]} : Vec{0, 0, 0};
}

template <int K>
void inverse_rows(const Rod<K>& rod, const Limits<K>& limits, const Settings& settings, const TaskRows& tasks,
                  std::size_t rows, const double* seeds, int threads, std::uint8_t* out) {
  Rod<K> arcs = rod;  // rows without load, in a fraction of the time: their last digits differ from single calls
  arcs.arcs = true;
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Vec load = load_of(tasks.targets.load, k);
      const Rod<K>& carries = loaded<K>(rod, load) ? rod : arcs;
      const Found<K> found = search_settled<K>(carries, tasks.task(k), load, limits, seeds + 3 * K * k, settings);
      const Outcome<K>& o = found.outcome;
      const std::uint64_t why =
          kOptimal * o.optimal | kStable * found.stable | kBlocked * o.blocked | kSnaps * (found.snap < kNoSnap);
      write_solution(out + k * solution_bytes(3 * K), o.pressures, 3 * K, o.residual, why, found.iterations, o.met);
    }
  });
}

template <int K>
void forward_rows(const Rod<K>& rod, const Settings& settings, const double* pressures, const double* loads,
                  std::size_t rows, int threads, std::uint8_t* out) {
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const double* p = pressures + 3 * K * k;
      const Vec load = load_of(loads, k);
      Ends ends;
      bool stable = true;
      if (loaded<K>(rod, load)) {
        Judged at;
        Vec moment;
        int elements;
        stable = fine_equilibrium<K>(rod, p, load, settings, moment, at, elements) == 1.0;
        if (!stable) buckled<K>(rod, p, load, elements, moment, at);
        ends = at.ends;
      } else {
        ends = unloaded_ends<K>(rod, p, settings.elements);
      }
      double tip[3], mid[3], direction[3];
      put(tip, ends.p), put(mid, ends.mid), put(direction, column(ends.R, 2));
      write_pose(out + k * kPoseBytes, tip, &ends.R.m[0][0], direction, mid, stable);
    }
  });
}

}  // namespace contid
