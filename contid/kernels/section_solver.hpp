// Bounded inverse kinematics of a chain of sections; scratch on the stack, nothing allocated in solve().
// Twin and specification: contid/models/solve.py and contid/models/descent.py: same decisions, same order.
#pragma once

#include <algorithm>

#include "closed_form.hpp"
#include "convex_step.hpp"

namespace contid {

constexpr int kLibrary = 256;
constexpr double kHopeless = 1e12;  // a shift that makes any Hessian of an arm positive definite

struct Tuning {
  double ell, tolerance, home_tolerance, weight, near;
  int home_steps;
  double contraction;
  double slow;
  int iterations, settling, starts, agreeing;
  double tracking;
};

struct Aim {
  const double* tip;
  const double* direction;  // may be null
  const double* mid;        // may be null
};

struct Answer {
  double lengths[kMostLengths];
  double residual;
  bool converged;
  std::uint64_t binding;
  int iterations;
  int starts;
};

// What ends the search of a target that is not met: so many starts that agree, or so many in all.
struct Patience {
  int agreeing, starts;
};

inline double halton(int index, int prime) {
  double value = 0.0, share = 1.0;
  for (; index > 0; index /= prime) {
    share /= prime;
    value += share * (index % prime);
  }
  return value;
}

inline double squared_distance(const double* a, const double* b) {
  double sum = 0.0;
  for (int k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

class SectionSolver {
 public:
  Feasible feasible;
  Tuning tuning;

  void prepare() {
    feasible.weigh_home();
    std::memcpy(home_factor_, feasible.metric, sizeof home_factor_);
    factor(home_factor_, feasible.size(), kMostLengths);
    static constexpr int kPrimes[kMostLengths] = {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
    for (int k = 0; k < kLibrary; ++k) {
      for (int i = 0; i < feasible.size(); ++i)
        library_[k][i] =
            feasible.low[i] + halton(k + 1, kPrimes[i]) * (feasible.high[i] - feasible.low[i]);
      feasible.pull(library_[k]);
      forward(feasible.sections, library_[k], frames_[k]);
    }
  }

  void solve(const Aim& aim, const double* seed, Answer& out) const {
    const int n = feasible.size();
    out.iterations = 0;
    out.starts = 0;
    if (closed_form(aim, out.lengths)) {
      feasible.clip(out.lengths);
      Task task;
      look(out.lengths, aim, task);
      out.residual = task.error;
      return finish(out);
    }
    double trial[kMostLengths], begun[kMostLengths];
    std::memcpy(trial, seed, n * sizeof(double));
    feasible.pull(trial);
    std::memcpy(begun, trial, n * sizeof(double));
    Task task;
    look(trial, aim, task);
    if (!(task.error < 1e6)) {  // not a number, or no place of this world: nothing to descend
      std::memcpy(out.lengths, trial, n * sizeof(double));
      out.residual = task.error;
      return finish(out);
    }
    out.residual = descend(trial, aim, out.iterations);
    out.starts = 1;
    std::memcpy(out.lengths, trial, sizeof trial);
    if (out.residual > tuning.tolerance) {
      int agreeing = 1;
      const bool biarcs = feasible.sections.count == 2 && aim.direction && !aim.mid;
      const double far = std::sqrt(dot(aim.tip, aim.tip, 3));
      double step = 0.0;
      for (int i = 0; i < n; ++i) step = std::max(step, std::fabs(trial[i] - begun[i]));
      const Patience patience{far > feasible.longest() ? tuning.agreeing : 2 * kLibrary,
                              step <= tuning.tracking * tuning.ell ? tuning.agreeing : 2 * kLibrary};
      if (!biarcs || !try_biarcs(aim, out, patience, agreeing)) try_library(aim, out, patience, agreeing);
    }
    finish(out);
  }

 private:
  struct Task {
    double e[kMostRows];
    double J[kMostRows][kMostLengths];
    int rows;
    double error;
  };

  double library_[kLibrary][kMostLengths];
  Frames frames_[kLibrary];
  double home_factor_[kMostLengths * kMostLengths];

  void finish(Answer& out) const {
    out.converged = out.residual <= tuning.tolerance;
    out.binding = feasible.binding(out.lengths);
  }

  bool closed_form(const Aim& aim, double* lengths) const {
    const Sections& s = feasible.sections;
    double arcs[6];
    if (s.count == 1 && !aim.direction && !aim.mid) {
      if (!through(aim.tip, s.rigid[0], arcs)) return false;
    } else if (s.count == 2 && !aim.direction && aim.mid) {
      if (!two_arcs(aim.mid, aim.tip, s.rigid, arcs)) return false;
    } else {
      return false;
    }
    for (int i = 0; i < s.count; ++i) s.lengths(i, arcs + 3 * i, lengths);
    double sum = 0.0;  // not finite when a length is not: a target on the rim of what arcs can reach
    for (int i = 0; i < s.size(); ++i) sum += lengths[i];
    int number;
    return std::isfinite(sum) && feasible.worst(lengths, 0, number) <= 1e-12;
  }

  // One more start; true when the search can end: the target is met, or enough starts agree.
  bool try_start(double* start, const Aim& aim, Answer& out, Patience patience, int& agreeing) const {
    const double left = descend(start, aim, out.iterations);
    ++out.starts;
    // A clear gain only, so that noise does not make the answer jump between equal minima.
    if (left <= tuning.tolerance || left < 0.999 * out.residual) {
      std::memcpy(out.lengths, start, kMostLengths * sizeof(double));
      out.residual = left;
      agreeing = 1;
    } else if (left < 1.001 * out.residual) {
      ++agreeing;
    }
    return out.residual <= tuning.tolerance || agreeing >= patience.agreeing || out.starts >= patience.starts;
  }

  bool try_biarcs(const Aim& aim, Answer& out, Patience patience, int& agreeing) const {
    constexpr int kLegs = 64, kBest = 3;
    const Sections& s = feasible.sections;
    const int n = feasible.size();
    double score[kLegs], lengths[kLegs][6] = {};
    int order[kLegs], found = 0;
    const double scale = (feasible.home[0] + feasible.home[1] + feasible.home[2]) / 3.0;
    for (int k = 0; k < kLegs; ++k) {
      const double leg = 0.5 * scale * std::tan(0.5 * kPi * ((2.0 * k + 1.0) / kLegs - 1.0));
      double arcs[6];
      if (!biarc(aim.tip, aim.direction, leg, s.rigid, arcs)) continue;
      double* l = lengths[found];
      for (int i = 0; i < 2; ++i) s.lengths(i, arcs + 3 * i, l);
      double sum = 0.0;
      for (int m = 0; m < feasible.limits(); ++m) {
        const double over = feasible.excess(l, m);
        if (over > 0.0) sum += over * over;
      }
      double from_home = 0.0;
      for (int i = 0; i < n; ++i) from_home += (l[i] - feasible.home[i]) * (l[i] - feasible.home[i]);
      score[found] = sum + 1e-4 * from_home;
      order[found] = found;
      ++found;
    }
    std::sort(order, order + found,
              [&](int a, int b) { return score[a] < score[b] || (score[a] == score[b] && a < b); });
    for (int k = 0; k < std::min(found, kBest); ++k) {
      double start[kMostLengths];
      std::memcpy(start, lengths[order[k]], n * sizeof(double));
      feasible.pull(start);
      if (try_start(start, aim, out, patience, agreeing)) return true;
    }
    return false;
  }

  void try_library(const Aim& aim, Answer& out, Patience patience, int& agreeing) const {
    double distance[kLibrary];
    int order[kLibrary];
    for (int k = 0; k < kLibrary; ++k) {
      const Frames& f = frames_[k];
      distance[k] = squared_distance(f.tip, aim.tip);
      if (aim.direction) {
        const double tangent[3] = {f.rotation[2], f.rotation[5], f.rotation[8]};
        distance[k] += tuning.ell * tuning.ell * squared_distance(tangent, aim.direction);
      }
      if (aim.mid) distance[k] += squared_distance(f.mid, aim.mid);
      order[k] = k;
    }
    std::sort(order, order + kLibrary, [&](int a, int b) {
      return distance[a] < distance[b] || (distance[a] == distance[b] && a < b);
    });
    for (int k = 0; k < tuning.starts; ++k) {  // the nearest ones, then ever farther ones
      double start[kMostLengths];
      std::memcpy(start, library_[order[std::min(k * (k + 7) / 8, kLibrary - 1)]], sizeof start);
      if (try_start(start, aim, out, patience, agreeing)) return;
    }
  }

  void look(const double* lengths, const Aim& aim, Task& task) const {
    const int n = feasible.size();
    Derivatives at;
    differentiate(feasible.sections, lengths, at, aim.mid != nullptr);
    for (int k = 0; k < 3; ++k) {
      task.e[k] = aim.tip[k] - at.frames.tip[k];
      std::memcpy(task.J[k], at.tip[k], n * sizeof(double));
    }
    task.rows = 3;
    if (aim.direction) {
      const double t[3] = {at.frames.rotation[2], at.frames.rotation[5], at.frames.rotation[8]};
      for (int k = 0; k < 3; ++k) {
        task.e[3 + k] = tuning.ell * (aim.direction[k] - t[k]);
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        for (int j = 0; j < n; ++j)
          task.J[3 + k][j] = tuning.ell * (at.spin[a][j] * t[b] - at.spin[b][j] * t[a]);
      }
      task.rows += 3;
    }
    if (aim.mid) {
      for (int k = 0; k < 3; ++k) {
        task.e[task.rows + k] = aim.mid[k] - at.frames.mid[k];
        std::memcpy(task.J[task.rows + k], at.mid[k], n * sizeof(double));
      }
      task.rows += 3;
    }
    task.error = std::sqrt(dot(task.e, task.e, task.rows));
  }

  // One start, in place: the error left [m]; steps taken are added to `iterations`.
  double descend(double* lengths, const Aim& aim, int& iterations) const {
    double error = approach(lengths, aim, tuning.home_steps, iterations);
    if (error > tuning.tolerance) error = approach(lengths, aim, 0, iterations);
    if (error > tuning.tolerance) {
      error = settle(lengths, aim, iterations);
      if (error <= tuning.tolerance) error = approach(lengths, aim, tuning.home_steps, iterations);
    }
    return error;
  }

  // Damped steps and homing, until the target is met or progress ends; the best lengths on the way, in place.
  double approach(double* best, const Aim& aim, int homes_left, int& iterations) const {
    const int n = feasible.size();
    const Tuning& t = tuning;
    Task tasks[2];
    int now = 0;
    double lengths[kMostLengths];
    std::memcpy(lengths, best, n * sizeof(double));
    look(lengths, aim, tasks[0]);
    double boost = 1.0, reach = t.ell, least = tasks[0].error;
    const double* home_factor = home_factor_;
    double metric[kMostLengths * kMostLengths];
    double last_step = kInfinity;
    for (int iteration = 0; iteration < t.iterations; ++iteration) {
      ++iterations;
      const Task& task = tasks[now];
      const bool homing = homes_left > 0 && task.error < t.near * t.ell;
      double z[kMostLengths] = {}, d[kMostLengths], trial[kMostLengths], damping = t.weight;
      if (homing) {
        --homes_left;
        for (int i = 0; i < n; ++i) z[i] = feasible.home[i] - lengths[i];
        const double far = std::sqrt(dot(z, z, n));
        const double share = far > reach ? reach / far : 1.0;
        double away[kMostLengths];
        for (int i = 0; i < n; ++i) away[i] = share * z[i];
        for (int i = 0; i < n; ++i) z[i] = dot(feasible.metric + i * kMostLengths, away, n);
      } else {
        damping += boost * task.error * task.error / (2.0 * t.ell * t.ell);
      }
      double y[kMostRows];
      damped_step(feasible, task.J, task.e, task.rows, damping, z, lengths, homing ? home_factor : nullptr, d, y);
      const double step = moved(lengths, d, trial);
      Task& next = tasks[1 - now];
      look(trial, aim, next);
      if (homing && next.error >= t.near * t.ell) {
        reach *= 0.25;
        continue;
      }
      if (!homing && next.error >= task.error && task.error > t.tolerance) {
        if (step < 1e-9) return least;
        boost *= 4.0;
        continue;
      }
      const bool slow = next.error > t.slow * task.error;
      std::memcpy(lengths, trial, n * sizeof(double));
      now = 1 - now;
      if (next.error < least || next.error <= t.tolerance) {
        std::memcpy(best, trial, n * sizeof(double));
        least = next.error;
      }
      if (homing && step > t.contraction * last_step) {
        home_metric(lengths, aim, next, y, metric);
        home_factor = metric;
      }
      last_step = homing ? step : kInfinity;
      if (!homing) boost = std::max(0.25 * boost, 1e-6);
      if (next.error <= t.tolerance && (!homing || step <= t.home_tolerance)) return next.error;
      if (!homing && slow && next.error > t.tolerance) return least;
    }
    return least;
  }

  // Second derivatives of |l - home|^2/2 - y^T task, shifted until positive definite: their factor.
  void home_metric(const double* lengths, const Aim& aim, const Task& task, const double* y,
                   double* metric) const {
    constexpr double kForward = 1e-6;  // [m]
    const int n = feasible.size();
    double rows[kMostLengths][kMostLengths], at[kMostLengths];
    std::memcpy(at, lengths, n * sizeof(double));
    for (int k = 0; k < n; ++k) {
      Task moved;
      at[k] = lengths[k] + kForward;
      look(at, aim, moved);
      at[k] = lengths[k];
      for (int i = 0; i < n; ++i) {
        double change = 0.0;
        for (int a = 0; a < task.rows; ++a) change += (moved.J[a][i] - task.J[a][i]) * y[a];
        rows[k][i] = feasible.metric[k * kMostLengths + i] - change / kForward;
      }
    }
    for (double shift = 0.5, added = 0.0;; added = shift, shift *= 4.0) {
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j) metric[i * kMostLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
        metric[i * kMostLengths + i] += added;
      }
      if (factor(metric, n, kMostLengths) || added > kHopeless) return;
    }
  }

  // Newton's method on |e|^2/2 for a target that is not met, to the minimum on the limits.
  double settle(double* lengths, const Aim& aim, int& iterations) const {
    constexpr double kLeastShift = 1e-3;
    const int n = feasible.size();
    Task tasks[2];
    int now = 0;
    look(lengths, aim, tasks[0]);
    double shift = 0.0, H[kMostLengths * kMostLengths], whiten[kMostLengths * kMostLengths];
    for (int iteration = 0; iteration < tuning.settling; ++iteration) {
      ++iterations;
      const Task& task = tasks[now];
      double push[kMostLengths];
      gradient(task, push);
      for (int i = 0; i < n; ++i) push[i] = -push[i];
      hessian(lengths, aim, H);
      stiffen(lengths, push, H);
      for (;;) {
        std::memcpy(whiten, H, sizeof H);
        for (int i = 0; i < n; ++i) whiten[i * kMostLengths + i] += shift + 1e-12;
        if (factor(whiten, n, kMostLengths)) break;
        shift = std::max(4.0 * shift, kLeastShift);
        if (shift > kHopeless) return task.error;
      }
      double d[kMostLengths], trial[kMostLengths];
      std::memcpy(d, push, sizeof d);
      solve_lower(whiten, n, kMostLengths, d);
      solve_upper(whiten, n, kMostLengths, d);
      bounded_step(whiten, lengths, feasible, nullptr, 0, 0.0, d);
      const double step = moved(lengths, d, trial);
      Task& next = tasks[1 - now];
      look(trial, aim, next);
      if (next.error >= task.error) {
        if (step < 1e-8) return task.error;
        shift = std::max(4.0 * shift, kLeastShift);
        continue;
      }
      std::memcpy(lengths, trial, n * sizeof(double));
      now = 1 - now;
      if (next.error <= tuning.tolerance || step < 1e-9) return next.error;
      shift = shift > kLeastShift ? 0.25 * shift : 0.0;
    }
    return tasks[now].error;
  }

  // trial = lengths + d, brought inside; returns the greatest move.
  double moved(const double* lengths, const double* d, double* trial) const {
    const int n = feasible.size();
    double step = 0.0;
    for (int i = 0; i < n; ++i) trial[i] = lengths[i] + d[i];
    feasible.pull(trial);
    for (int i = 0; i < n; ++i) step = std::max(step, std::fabs(trial[i] - lengths[i]));
    return step;
  }

  // Of |e|^2/2: -J^T e.
  void gradient(const Task& task, double* out) const {
    for (int i = 0; i < feasible.size(); ++i) {
      out[i] = 0.0;
      for (int a = 0; a < task.rows; ++a) out[i] -= task.J[a][i] * task.e[a];
    }
  }

  // Limits that bind and are pushed against: the step will not cross them, so H may be stiff across them.
  void stiffen(const double* lengths, const double* push, double* H) const {
    const int n = feasible.size();
    double most = 0.0, normal[kMostLengths];
    for (int i = 0; i < n; ++i) most = std::max(most, std::fabs(H[i * kMostLengths + i]));
    for (std::uint64_t bits = feasible.binding(lengths), k = 0; bits >> k; ++k) {
      if (!(bits >> k & 1)) continue;
      feasible.normal(lengths, static_cast<int>(k), normal);
      if (dot(normal, push, n) <= 0.0) continue;
      const double weight = 10.0 * most / dot(normal, normal, n);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) H[i * kMostLengths + j] += weight * normal[i] * normal[j];
    }
  }

  // Of |e|^2/2, from central differences of its gradient.
  void hessian(const double* lengths, const Aim& aim, double* H) const {
    constexpr double kDifference = 1e-5;  // [m]: 1e-10 of truncation, 1e-11 of rounding
    const int n = feasible.size();
    double rows[kMostLengths][kMostLengths], at[kMostLengths], up[kMostLengths], down[kMostLengths];
    std::memcpy(at, lengths, n * sizeof(double));
    for (int k = 0; k < n; ++k) {
      Task task;
      at[k] = lengths[k] + kDifference;
      look(at, aim, task);
      gradient(task, up);
      at[k] = lengths[k] - kDifference;
      look(at, aim, task);
      gradient(task, down);
      at[k] = lengths[k];
      for (int i = 0; i < n; ++i) rows[k][i] = (up[i] - down[i]) / (2.0 * kDifference);
    }
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) H[i * kMostLengths + j] = 0.5 * (rows[i][j] + rows[j][i]);
  }
};

}  // namespace contid
