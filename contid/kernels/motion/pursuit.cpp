#include "pursuit.hpp"

#include <algorithm>
#include <cmath>

#include "solver.hpp"

namespace contid {

namespace {

// Share of the velocity limit that a frame moves at most: the axes can still come nearer.
constexpr double kFrameShare = 0.95;
// Shares of the jerk limit, tried in turn: ruckig 0.19 finds no profile exactly at the border of two kinds.
constexpr double kJerks[] = {1.0 - 1e-6, 1.0 - 1e-4, 1.0 - 1e-2};

// What is below the resolution of a motion counts as none: the solver would take it for a way of its own.
double rounded(double value) { return std::fabs(value) < kNegligible ? 0.0 : value; }

// By how much each axis moves when that with the longest way moves by 1; false where rates lead aside. `way`: where
// each axis has to go, or the velocity that it has to lose; `most`: greatest acceleration.
bool shares_of_line(int axes, const double* way, const double* velocity, const double* acceleration, const double* most,
                    double* shares) {
  int lead = 0;
  for (int k = 1; k < axes; ++k)
    if (std::fabs(way[k]) > std::fabs(way[lead])) lead = k;
  if (way[lead] == 0.0) return false;
  for (int k = 0; k < axes; ++k) {
    shares[k] = way[k] / way[lead];
    if (!(std::fabs(velocity[k] - shares[k] * velocity[lead]) <= kParallel &&
          std::fabs(acceleration[k] - shares[k] * acceleration[lead]) <= kParallel * most[k]))
      return false;
  }
  return true;
}

struct Frame {
  const double *origin, *velocity;  // after the time; of the frame
};

// The state after `time_s` of the motion from a state to rest in a frame. `gaps`: from the origin of the frame, where
// an axis comes to rest, to the axis now; zeros for a stop, whose positions count from where it begins.
bool planned(const double* gaps, const Moving& state, const Frame& frame, const AxisRates& rates, Control control,
             Arrival arrival, Lines lines, double time_s, Moving& after) {
  const int n = rates.axes;
  const double* const scale = rates.velocity;
  AxisNumbers start, shares;
  bool line = false, moves = false;
  MotionSolver& of_all = MotionSolver::of(n);
  ScaledMotion& all = of_all.asked();
  for (int k = 0; k < n; ++k) {
    start[k] = gaps[k] / scale[k];
    const double v = all.velocity[k] = rounded((state.velocity[k] - frame.velocity[k]) / scale[k]);
    const double a = all.acceleration[k] = rounded(state.acceleration[k] / scale[k]);
    // `start` is not rounded: the line leads from where the axis is. A distance that is rounded in motion is a step.
    all.position[k] = lines == Lines::kExact && (v != 0.0 || a != 0.0) ? start[k] : rounded(start[k]);
    all.top[k] = 1.0 - frame.velocity[k] / scale[k], all.low[k] = -1.0 - frame.velocity[k] / scale[k];
    all.most[k] = rates.acceleration[k] / scale[k], all.jerk[k] = rates.jerk[k] / scale[k];
    moves = moves || all.position[k] != 0.0;
  }
  if (lines != Lines::kNone && arrival != Arrival::kEach) {
    const double* way = control == Control::kVelocity     ? all.velocity.data()
                        : lines == Lines::kExact && moves ? start
                                                          : all.position.data();
    line = shares_of_line(n, way, all.velocity.data(), all.acceleration.data(), all.most.data(), shares);
  }
  MotionSolver& solver = line ? MotionSolver::of(1) : of_all;
  if (line) {
    const int lead = static_cast<int>(std::find(shares, shares + n, 1.0) - shares);
    double low = -HUGE_VAL, top = HUGE_VAL, most = HUGE_VAL, jerk = HUGE_VAL;
    for (int k = 0; k < n; ++k) {
      if (shares[k] == 0.0) continue;
      const double one = all.low[k] / shares[k], other = all.top[k] / shares[k];
      low = std::max(low, std::min(one, other)), top = std::min(top, std::max(one, other));
      most = std::min(most, all.most[k] / std::fabs(shares[k])),
      jerk = std::min(jerk, all.jerk[k] / std::fabs(shares[k]));
    }
    const double at = all.position[lead], v = all.velocity[lead], a = all.acceleration[lead];
    ScaledMotion& one = solver.asked();
    one.position[0] = at, one.velocity[0] = v, one.acceleration[0] = a;
    one.low[0] = low, one.top[0] = top, one.most[0] = most, one.jerk[0] = jerk;
  }
  const bool found = std::any_of(std::begin(kJerks), std::end(kJerks),
                                 [&](double share) { return solver.solve(control, arrival, share); });
  if (!found) return false;
  const ScaledState& at = solver.at(time_s);
  const double x = at.position[0], v = at.velocity[0], a = at.acceleration[0];
  const double moved = line ? x - solver.start() : 0.0;
  for (int k = 0; k < n; ++k) {
    const double p = line ? start[k] + shares[k] * moved : at.position[k];
    const double speed = line ? shares[k] * v : at.velocity[k], change = line ? shares[k] * a : at.acceleration[k];
    if (!std::isfinite(p) || !std::isfinite(speed) || !std::isfinite(change)) return false;
    after.position[k] = frame.origin[k] + p * scale[k];
    after.velocity[k] = frame.velocity[k] + speed * scale[k];
    after.acceleration[k] = change * scale[k];
  }
  return true;
}

constexpr AxisNumbers kStill = {};

}  // namespace

void frame_velocity(const double* pace, const AxisRates& rates, double* frame) {
  bool jumped = false;
  for (int k = 0; k < rates.axes; ++k) {
    const double top = kFrameShare * rates.velocity[k];
    jumped = jumped || std::fabs(pace[k]) > rates.velocity[k];
    frame[k] = std::min(std::max(pace[k], -top), top);
  }
  if (jumped) std::fill_n(frame, rates.axes, 0.0);
}

bool pursued(const Moving& state, const double* goal, const double* frame, const AxisRates& rates, double time_s,
             bool together, Lines lines, Moving& after) {
  AxisNumbers gaps;
  for (int k = 0; k < rates.axes; ++k) gaps[k] = state.position[k] - goal[k] + frame[k] * time_s;
  return planned(gaps, state, {goal, frame}, rates, Control::kPosition, together ? Arrival::kStraight : Arrival::kEach,
                 lines, time_s, after);
}

bool kept_line(const Moving& state, const double* goal, const AxisRates& rates, double time_s, Lines lines,
               Moving& after) {
  AxisNumbers velocity = {}, acceleration = {}, most = {}, shares, end;
  for (int k = 0; k < rates.axes; ++k) {
    velocity[k] = rounded(state.velocity[k] / rates.velocity[k]);
    acceleration[k] = rounded(state.acceleration[k] / rates.velocity[k]);
    most[k] = rates.acceleration[k] / rates.velocity[k];
  }
  if (!shares_of_line(rates.axes, velocity, velocity, acceleration, most, shares)) return false;
  double along = 0.0, squares = 0.0;
  for (int k = 0; k < rates.axes; ++k) {
    along += shares[k] * (goal[k] - state.position[k]) / rates.velocity[k];
    squares += shares[k] * shares[k];
  }
  const double way = along / squares;
  for (int k = 0; k < rates.axes; ++k) end[k] = state.position[k] + way * shares[k] * rates.velocity[k];
  return pursued(state, end, kStill, rates, time_s, true, lines, after);
}

bool braked(const Moving& state, const AxisRates& rates, double time_s, bool together, Lines lines, Moving& after) {
  return planned(kStill, state, {state.position, kStill}, rates, Control::kVelocity,
                 together ? Arrival::kTogether : Arrival::kEach, lines, time_s, after);
}

}  // namespace contid
