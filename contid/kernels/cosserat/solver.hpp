// What the kernel answers about one arm: between the bindings (cosserat.cpp) and the searches (search.cpp).
#pragma once

#include "../batch.hpp"
#include "limits.hpp"
#include "task.hpp"

namespace contid {

// See RodSetup in contid/kinematics/cosserat/engine.py.
struct Settings {
  int elements;      // integration steps per section to begin with
  double tolerance;  // task error that counts as met [mm]
  double error;      // estimated error of tip and mid-point above which elements are doubled [mm]
  bool thorough;     // false: a search fits into a few ticks
};

// A search's answer. See InverseAnswer in contid/kinematics/cosserat/engine.py.
struct Answer {
  double pressures[kMost];  // [bar]
  double residual;          // norm of the task error [mm]
  double statics;           // norm of the moment balance at the tip [N*mm]
  double snap;              // part of the straight path to the target at which the arm snaps; kNoSnap: it gets there
  bool met;                 // task and equilibrium hold to their tolerances
  bool optimal;             // no feasible change reduces the task error further
  bool blocked;             // the last steps led out of the stable equilibria
  bool stable;              // the equilibrium is a minimum of energy
  int iterations;           // sweeps with derivatives and their like
  int elements;             // integration steps per section
};

// A pose under given pressures; `done` is the part of the loads up to which its branch goes.
struct Equilibrium {
  Ends ends;
  Vec moment;
  int elements;
  double done;
};

// An equilibrium near a known one, with the derivatives of the tip.
struct Near {
  Vec tip, moment;
  Mat by_force;                   // [mm/N]
  double by_pressure[3 * kMost];  // [mm/bar], row-major
};

// The tasks of a batch.
struct TaskRows {
  TargetRows targets;
  double length;       // scales the error of a direction to mm
  bool full_rotation;  // a direction stands for the whole twist-free frame

  Task task(std::size_t k) const;
};

struct Arm {
  Rod rod;
  Limits limits;
  Settings settings;

  // `seed`: the last commanded pressures, never null.
  Answer inverse(const Task& task, Vec force, const double* seed) const;
  // Under the loads of `carrying`, a copy of the rod with other loads, or of the rod itself. Follows the branch from
  // rest with as many elements as the load demands (fine_equilibrium).
  Equilibrium forward(const Rod& carrying, const double* pressures, Vec force) const;
  // From a guess of the base moment, without following the branch (near_equilibrium): a bounded piece of work for every
  // tick. False where Newton's method does not contract from the guess, or the equilibrium is unstable.
  bool near(const double* pressures, Vec force, Vec guess, Near& out) const;
  // Least factor of the force at which the arm buckles; below 0 when it is stable up to `max_factor`.
  double critical(const double* pressures, Vec force, double max_factor) const;
  // The rows of `out` are solutions (write_solution), those of `seeds` pressures.
  void inverse_rows(const TaskRows& tasks, std::size_t rows, const double* seeds, int threads, std::uint8_t* out) const;
  // The rows of `out` are poses (write_pose), kPoseBytes each. `loads`, three numbers a row, may be null: none.
  void forward_rows(const double* pressures, const double* loads, std::size_t rows, int threads,
                    std::uint8_t* out) const;
};

}  // namespace contid
