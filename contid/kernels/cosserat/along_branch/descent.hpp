// Descent of the task error along the branch and along its boundary.
//
//     minimise  |r(P)|^2   over the pressures P in their limits whose path from rest is stable
//
// Gauss-Newton steps in a trust box from one pose on the branch: every step ends in an equilibrium near the one before,
// found by Newton's method, and must lower the error. Whether poses are on the branch is checked every few steps; the
// descent goes back to the last that is. Next to the boundary of the stable pressures (boundary.hpp) every step is
// checked, and a plane keeps the next ones in front of it. It stops on the target, where a step gains nothing or the
// trust box has vanished, or by its `StopRule`. Slower than solve.hpp, which balances the moments on the way and may
// end in any equilibrium.
#pragma once

#include "../solve.hpp"
#include "boundary.hpp"

namespace contid {

// Stiffness that paths must keep: nearer to a fork, other elements and other regulators go on on either side.
constexpr double kMargin = 0.01;
constexpr double kNoGain = 1e-9, kNoTrust = 1e-6, kLeastRoom = 1e-4;
constexpr int kRecent = 5, kUnchecked = 8, kRetreats = 2;

// When a descent ends: after its work, where `kRecent` steps gain too little, or where another outcome is out of sight.
struct StopRule {
  int work;
  double gain = 0.0;               // of the last steps, as a part of the error
  double best = 0.0, ahead = 0.0;  // ahead times that gain must reach `best`
  double trust = kNoTrust, room = kLeastRoom;
};

// A pose on the branch, and the path to it from rest.
struct BranchPose {
  double pressures[kMost] = {};
  Vec moment;
  Judged at;
  Ramp ramp;
};

// An outcome that is a pose on the branch.
inline Outcome outcome_of(const Task& task, const BranchPose& pose, double tolerance) {
  Outcome o{};
  std::copy(pose.pressures, pose.pressures + kMost, o.pressures);
  o.moment = pose.moment, o.at = pose.at;
  o.residual = task_error(task, pose.at.ends), o.statics = norm(pose.at.ends.moment);
  o.met = o.optimal = o.residual <= tolerance;
  o.blocked = !o.met;
  return o;
}

// From one pose on the branch to others, each near the one before. Whether they are on the branch is checked every few
// steps, and at every step next to its boundary.
struct Descent {
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  int elements;
  double tolerance;

  struct Point {
    double p[kMost], r[9], cost;
    Vec moment;
    Judged at;
  };
  Point points[kUnchecked + 1]{};  // the first is on the branch
  int ahead = 0;                   // points after it
  Ramp ramp{};                     // the path from rest to the first
  const int n = rod.pressures();
  StableBoundary boundary{n};
  Sweep here{};
  Reduced by{};
  double trust = kTrustStart, margin = kMargin;
  int work = 0, step = 0, retreats = 0;
  bool bounded = false, normal_is_old = false, fresh = false, blocked = false, optimal = false;

  void measure(Point& point) const {
    residual(task, point.at.ends, point.r);
    point.cost = 0.0;
    for (int a = 0; a < task.rows(); ++a) point.cost += point.r[a] * point.r[a];
  }

  bool on_branch_at(const Point& point, Ramp& path) {
    Vec found;
    Judged at;
    const double done = ramped(rod, point.p, force, elements, found, at, path);
    work += path.work();
    return done == 1.0 && path.least >= margin && same_pose(rod, force, found, point.moment);
  }

  // After a step from the first point led off the branch: the next ones keep in front of its boundary.
  void set_boundary(const double* d) {
    double size = 0.0;
    for (int j = 0; j < n; ++j) size = std::fmax(size, std::fabs(d[j]));
    const Point& at = points[0];
    bounded = boundary.find_normal(rod, at.p, at.moment, at.at, force, elements, ramp) && boundary.orient(d);
    trust = bounded ? size : kShrink * size;
    normal_is_old = false, retreats = 0, blocked = true;
  }

  // The last point becomes the first. Back to the last one on the branch, and false, where it is not.
  bool check() {
    if (ahead == 0) return true;
    Ramp path;
    int good = 0, bad = ahead;
    if (on_branch_at(points[ahead], path)) {
      good = ahead, ramp = path;
    } else {
      while (bad - good > 1) {
        const int middle = (good + bad) / 2;
        if (on_branch_at(points[middle], path))
          good = middle, ramp = path;
        else
          bad = middle;
      }
    }
    double d[kMost];
    for (int j = 0; j < n; ++j) d[j] = points[bad].p[j] - points[good].p[j];
    points[0] = points[good];
    const bool all = good == ahead;
    ahead = 0;
    if (all) return true;
    fresh = false, step = 0;
    set_boundary(d);
    return false;
  }

  void accept(const Point& next, const Ramp& path, bool limited, double along) {
    fresh = false, blocked = limited;
    if (!bounded) {
      points[++ahead] = next;
      if (ahead == kUnchecked) check();
      return;
    }
    points[0] = next, ramp = path, normal_is_old = true;
    if (limited)
      boundary.room *= 2.0;
    else if (along < 0.0 && ++retreats > kRetreats)
      bounded = false;
  }

  // One step or a shorter limit of it; false where neither helps any more.
  bool advance(const StopRule& stop) {
    const Point& now = points[ahead];
    if (!fresh) {
      sweep(rod, now.p, now.moment, force, 1.0, elements, here);
      if (!by.eliminate(rod, task, here, 0.0)) return false;
      fresh = true;
    }
    if (bounded && normal_is_old) {
      double before[kMost];
      std::copy(boundary.normal, boundary.normal + n, before);
      bounded = boundary.find_normal(rod, now.p, now.moment, now.at, force, elements, ramp);
      if (bounded && boundary.along_normal(before) < 0.0)
        for (int j = 0; j < n; ++j) boundary.normal[j] = -boundary.normal[j];
      normal_is_old = false;
    }
    double g[kMost], low[kMost], high[kMost], d[kMost], size = 0.0, gain = 0.0;
    for (int j = 0; j < n; ++j) {
      g[j] = 0.0;
      for (int a = 0; a < task.rows(); ++a) g[j] += by.J[a][j] * now.r[a];
      low[j] = std::max(limits.lower[j] - now.p[j], -trust);
      high[j] = std::min(limits.upper[j] - now.p[j], trust);
    }
    box_step(n, by.H, g, low, high, d);
    const bool limited = bounded && boundary.limit(by.H, g, low, high, d);
    const double along = bounded ? boundary.along_normal(d) : 0.0;
    for (int j = 0; j < n; ++j) {
      size = std::fmax(size, std::fabs(d[j]));
      double curved = 0.0;
      for (int i = 0; i < n; ++i) curved += by.H[j][i] * d[i];
      gain -= d[j] * (2.0 * g[j] + curved);
    }
    if (gain <= kNoGain * now.cost) {
      optimal = !limited && !blocked;
      return false;
    }
    Point next;
    for (int j = 0; j < n; ++j) next.p[j] = std::min(std::max(now.p[j] + d[j], limits.lower[j]), limits.upper[j]);
    next.moment = now.moment - by.moment_step(d, 0.0, {0, 0, 0});
    bool stable = settle(rod, next.p, next.moment, force, 1.0, elements, kStatics, next.at);
    if (stable) measure(next);
    const bool lower = stable && next.cost < now.cost;
    Ramp path;
    if (lower && bounded) stable = on_branch_at(next, path);
    if (lower && stable) {
      if (now.cost - next.cost > 0.75 * gain) trust = std::fmax(trust, 2.0 * size);
      if (now.cost - next.cost < 0.25 * gain) trust = 0.5 * size;
      accept(next, path, limited, along);
      return true;
    }
    if (stable) {
      trust = kShrink * size;
      if (trust < stop.trust) optimal = !blocked && trust < kNoTrust;
    } else if (!bounded) {
      if (check()) set_boundary(d);
    } else if (std::fmin(boundary.room, along) > stop.room) {
      blocked = true;
      boundary.room = kShrink * std::fmin(boundary.room, along);
      trust = std::fmin(trust, size);
    } else {
      blocked = true;
      trust = kShrink * size;
    }
    return trust >= stop.trust;
  }

  // The first of the points.
  BranchPose pose() const {
    BranchPose first;
    std::copy(points[0].p, points[0].p + n, first.pressures);
    first.moment = points[0].moment, first.at = points[0].at, first.ramp = ramp;
    return first;
  }

  Outcome run(const BranchPose& start, const StopRule& stop) {
    std::copy(start.pressures, start.pressures + n, points[0].p);
    points[0].moment = start.moment, points[0].at = start.at, ramp = start.ramp;
    margin = std::fmin(kMargin, ramp.least);
    measure(points[0]);
    double recent[kRecent] = {};
    for (;;) {
      const double cost = points[ahead].cost, error = std::sqrt(cost);
      bool over = cost <= tolerance * tolerance || work >= stop.work;
      if (!over && !fresh) {  // a step was made
        const double gained = recent[step % kRecent] - error;
        over = step >= kRecent &&
               (gained < stop.gain * error || (stop.ahead > 0.0 && error - stop.best > stop.ahead * gained));
        recent[step++ % kRecent] = error;
      }
      if (!over) {
        ++work;
        over = !advance(stop);
      }
      if (!over) continue;
      if (check() || work >= stop.work) break;
      optimal = false;
    }
    Outcome out{};
    const Point& end = points[0];
    std::copy(end.p, end.p + n, out.pressures);
    out.moment = end.moment, out.at = end.at, out.iterations = work;
    out.residual = std::sqrt(end.cost), out.statics = norm(end.at.ends.moment);
    out.met = end.cost <= tolerance * tolerance;
    out.optimal = optimal || out.met;
    out.blocked = blocked && !out.met;
    return out;
  }
};

inline Outcome descend(const Rod& rod, const Task& task, Vec tip_force, const Limits& limits, const BranchPose& start,
                       int elements, double tolerance, const StopRule& stop) {
  Descent descent{rod, task, tip_force, limits, elements, tolerance};
  return descent.run(start, stop);
}

}  // namespace contid
