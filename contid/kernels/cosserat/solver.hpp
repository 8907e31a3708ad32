// What the kernel answers about one arm: between the bindings (cosserat.cpp) and the searches (search.cpp).
#pragma once

#include "../batch.hpp"
#include "limits.hpp"
#include "task.hpp"

namespace contid {

struct Settings {
  int elements;
  double tolerance, error;
  bool thorough;  // false: a search fits into a few ticks
};

// A search's answer.
struct Answer {
  double pressures[kMost], residual, statics, snap;
  bool met, optimal, blocked, stable;
  int iterations, elements;
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
  double length;
  bool full_rotation;

  Task task(std::size_t k) const;
};

struct Arm {
  Rod rod;
  Limits limits;
  Settings settings;

  Answer inverse(const Task& task, Vec force, const double* seed) const;
  // Under the loads of `carrying`, a copy of the rod with other loads, or of the rod itself.
  Equilibrium forward(const Rod& carrying, const double* pressures, Vec force) const;
  // A bounded piece of work for every tick; false where Newton's method does not contract from the guess.
  bool near(const double* pressures, Vec force, Vec guess, Near& out) const;
  // Least factor of the force at which the arm buckles; below 0 when it is stable up to `max_factor`.
  double critical(const double* pressures, Vec force, double max_factor) const;
  void inverse_rows(const TaskRows& tasks, std::size_t rows, const double* seeds, int threads, std::uint8_t* out) const;
  // `loads` may be null.
  void forward_rows(const double* pressures, const double* loads, std::size_t rows, int threads,
                    std::uint8_t* out) const;
};

}  // namespace contid
