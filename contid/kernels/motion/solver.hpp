// Motions of ruckig to rest at zero, with the velocity limit of every axis as unit.
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace contid {

// What is controlled: the way to a position, or the loss of a velocity.
enum class Control { kPosition, kVelocity };
// Each axis as early as it can, all at the same instant, or that on a straight line where ruckig finds one.
enum class Arrival { kEach, kTogether, kStraight };

struct ScaledState {
  std::vector<double> position, velocity, acceleration;  // s, 1, 1/s
};

// A state, and the limits of velocity, acceleration and jerk; rest is at `goal`.
struct ScaledMotion : ScaledState {
  std::vector<double> goal, low, top, most, jerk;
};

class MotionSolver {
 public:
  explicit MotionSolver(int axes);
  ~MotionSolver();

  // One that this thread keeps for a number of axes.
  static MotionSolver& of(int axes);

  // To be filled in before `solve`.
  ScaledMotion& asked() { return asked_; }

  // Whether a motion within a share of the limits of jerk was found.
  bool solve(Control control, Arrival arrival, double jerk_share);
  // As `solve`; why none was found, "" for one that was.
  std::string reason(Control control, Arrival arrival, double jerk_share);

  double duration_s() const;
  // Of the first axis.
  double start() const;
  const ScaledState& at(double time_s) const;

 private:
  struct Ruckig;
  void fill(Control control, Arrival arrival, double jerk_share);

  ScaledMotion asked_;
  mutable ScaledState at_;
  std::unique_ptr<Ruckig> ruckig_;
};

}  // namespace contid
