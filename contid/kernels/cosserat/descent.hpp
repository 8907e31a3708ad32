// Descent of the task error along the branch: twin of contid/kinematics/cosserat/descent.py, its specification.
#pragma once

#include "ramp.hpp"
#include "solve.hpp"

namespace contid {

constexpr double kShrink = 0.25, kNoGain = 1e-12, kNoTrust = 1e-7;
constexpr int kRecent = 3;

// When a descent ends: after its work, where `kRecent` steps gain too little, or where another outcome is out of sight.
struct StopRule {
  int work;
  double gain = 0.0;               // of the last steps, as a part of the error
  double best = 0.0, ahead = 0.0;  // ahead times that gain must reach `best`
  double trust = kNoTrust;
};

// A pose on the branch, and the way to it.
template <int K> struct BranchPose {
  double pressures[3 * K];
  Vec moment;
  Judged at;
  Ramp<K> ramp;
};

// From one pose on the branch to others, each near the one before.
template <int K>
Outcome<K> descend(const Rod<K>& rod, const Task& task, Vec tip_force, const Limits<K>& limits,
                   const BranchPose<K>& start, int elements, double tolerance, const StopRule& stop) {
  constexpr int n = 3 * K;
  const int rows = task.rows();
  Outcome<K> out{};
  double* p = out.pressures;
  std::copy(start.pressures, start.pressures + n, p);
  out.at = start.at;
  Vec moment = start.moment;
  Ramp<K> ramp = start.ramp;
  const auto squared = [&](const Ends& ends, double* r) {
    residual(task, ends, r);
    double sum = 0.0;
    for (int a = 0; a < rows; ++a) sum += r[a] * r[a];
    return sum;
  };
  double r[9], g[n], low[n], high[n], d[n], next[n], next_r[9], trust = kTrustStart, recent[kRecent] = {};
  double cost = squared(start.at.ends, r);
  Sweep<K> here;
  Reduced<K> by;
  bool fresh = false;
  for (int step = 0; cost > tolerance * tolerance && out.iterations < stop.work; ++step) {
    ++out.iterations;
    const double error = std::sqrt(cost);
    if (step >= kRecent) {
      const double gained = recent[step % kRecent] - error;
      if (gained < stop.gain * error || (stop.ahead > 0.0 && error - stop.best > stop.ahead * gained)) break;
    }
    recent[step % kRecent] = error;
    if (!fresh) {
      sweep<K, true>(rod, p, moment, tip_force, 1.0, elements, here);
      if (!by.eliminate(rod, task, here, 0.0)) break;
      fresh = true;
    }
    for (int j = 0; j < n; ++j) {
      g[j] = 0.0;
      for (int a = 0; a < rows; ++a) g[j] += by.J[a][j] * r[a];
      low[j] = std::max(limits.lower[j] - p[j], -trust);
      high[j] = std::min(limits.upper[j] - p[j], trust);
    }
    box_step<n>(by.H, g, low, high, d);
    double size = 0.0, gain = 0.0;
    for (int j = 0; j < n; ++j) {
      size = std::fmax(size, std::fabs(d[j]));
      double curved = 0.0;
      for (int i = 0; i < n; ++i) curved += by.H[j][i] * d[i];
      gain -= d[j] * (2.0 * g[j] + curved);
    }
    if (gain <= kNoGain * cost) {
      out.optimal = !out.blocked;
      break;
    }
    for (int j = 0; j < n; ++j) next[j] = std::min(std::max(p[j] + d[j], limits.lower[j]), limits.upper[j]);
    Vec next_moment = moment - by.moment_step(d, 0.0, {0, 0, 0});
    Judged trial;
    bool stands = settle<K>(rod, next, next_moment, tip_force, 1.0, elements, kStatics, trial);
    const double next_cost = stands ? squared(trial.ends, next_r) : cost;
    if (stands && next_cost < cost)
      stands = keeps_to_branch<K>(rod, next, next_moment, moment, tip_force, elements, ramp, out.iterations);
    if (stands && next_cost < cost) {
      if (cost - next_cost > 0.75 * gain) trust = std::fmax(trust, 2.0 * size);
      if (cost - next_cost < 0.25 * gain) trust = 0.5 * size;
      std::copy(next, next + n, p);
      std::copy(next_r, next_r + rows, r);
      moment = next_moment;
      out.at = trial;
      cost = next_cost;
      fresh = false;
      out.blocked = false;
    } else {
      trust = kShrink * size;
      out.blocked = out.blocked || !stands;
      if (trust < stop.trust) {
        out.optimal = !out.blocked && trust < kNoTrust;
        break;
      }
    }
  }
  out.moment = moment;
  out.residual = std::sqrt(cost);
  out.statics = norm(out.at.ends.moment);
  out.met = cost <= tolerance * tolerance;
  out.optimal = out.optimal || out.met;
  return out;
}

}  // namespace contid
