// The searches of one arm and of many rows. Specification of rows: contid/kinematics/batch/loop.py.
#include "near.hpp"
#include "settled.hpp"

namespace contid {

namespace {

// What a row's field `limited_by` holds: see contid/kinematics/batch/pneumatic.py. kSnaps: the arm snaps through on
// the straight path to the target (kNoSnap, along_branch/straight_path.hpp).
constexpr std::uint64_t kOptimal = 1, kStable = 2, kBlocked = 4, kSnaps = 8;

inline Vec load_of(const double* loads, std::size_t k) {
  return loads ? Vec{loads[3 * k], loads[3 * k + 1], loads[3 * k + 2]} : Vec{0, 0, 0};
}

}  // namespace

Answer Arm::inverse(const Task& task, Vec force, const double* seed) const {
  const Found found = search_settled(rod, task, force, limits, seed, settings);
  const Outcome& o = found.outcome;
  Answer answer;
  std::copy(o.pressures, o.pressures + kMost, answer.pressures);
  answer.residual = o.residual;
  answer.statics = o.statics;
  answer.snap = found.snap;
  answer.met = o.met;
  answer.optimal = o.optimal;
  answer.blocked = o.blocked;
  answer.stable = found.stable;
  answer.iterations = found.iterations;
  answer.elements = found.elements;
  return answer;
}

Equilibrium Arm::forward(const Rod& carrying, const double* pressures, Vec force) const {
  Judged at;  // the ends of the rod in the equilibrium that was reached, and their derivatives
  Equilibrium out;
  out.done = fine_equilibrium(carrying, pressures, force, settings, out.moment, at, out.elements);
  // The branch ends before the full loads: some other equilibrium under them.
  if (out.done < 1.0) buckled(carrying, pressures, force, out.elements, out.moment, at);
  out.ends = at.ends;
  return out;
}

bool Arm::near(const double* pressures, Vec force, Vec guess, Near& out) const {
  return near_equilibrium(rod, pressures, force, guess, settings.elements, out);
}

double Arm::critical(const double* pressures, Vec force, double max_factor) const {
  return critical_factor(rod, pressures, force, max_factor, settings.elements);
}

Task TaskRows::task(std::size_t k) const {
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

void Arm::inverse_rows(const TaskRows& tasks, std::size_t rows, const double* seeds, int threads,
                       std::uint8_t* out) const {
  const int n = rod.pressures();
  Rod arcs = rod;  // rows without load, in a fraction of the time: their last digits differ from single calls
  arcs.arcs = true;
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Vec load = load_of(tasks.targets.load, k);
      const Rod& carries = loaded(rod, load) ? rod : arcs;
      const Found found = search_settled(carries, tasks.task(k), load, limits, seeds + n * k, settings);
      const Outcome& o = found.outcome;
      const std::uint64_t why =
          kOptimal * o.optimal | kStable * found.stable | kBlocked * o.blocked | kSnaps * (found.snap < kNoSnap);
      write_solution(out + k * solution_bytes(n), o.pressures, n, o.residual, why, found.iterations, o.met);
    }
  });
}

void Arm::forward_rows(const double* pressures, const double* loads, std::size_t rows, int threads,
                       std::uint8_t* out) const {
  const int n = rod.pressures();
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const double* p = pressures + n * k;
      const Vec load = load_of(loads, k);
      Ends ends;
      bool stable = true;
      if (loaded(rod, load)) {
        Judged at;
        Vec moment;
        int elements;
        stable = fine_equilibrium(rod, p, load, settings, moment, at, elements) == 1.0;
        if (!stable) buckled(rod, p, load, elements, moment, at);
        ends = at.ends;
      } else {
        ends = unloaded_ends(rod, p, settings.elements);
      }
      double tip[3], mid[3], direction[3];
      put(tip, ends.p), put(mid, ends.mid), put(direction, column(ends.R, 2));
      write_pose(out + k * kPoseBytes, tip, &ends.R.m[0][0], direction, mid, stable);
    }
  });
}

}  // namespace contid
