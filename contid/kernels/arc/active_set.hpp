// The bounded step: a strictly convex quadratic programme over the feasible lengths, by dual active sets
//
//     minimise 1/2 (d - d0)^T H (d - d0) with l + d feasible,    d0 the step without limits
//
// after Goldfarb and Idnani (1983). Twin and specification: contid/kinematics/arc/active_set.py.
#pragma once

#include "cholesky.hpp"
#ifdef CONTID_TENDON
#include "../tendon/feasible.hpp"
#else
#include "feasible.hpp"
#endif

namespace contid {

constexpr int kMaxRows = 9;  // of a task: tip, direction, mid-point
constexpr int kMaxHeld = kMaxLengths + kMaxRows;
constexpr double kRounding = 1e-12;  // excess that counts as rounding [m]; the caller pulls the rest inside
constexpr int kLimitsTried = 40;

// What the step is held to, in whitened coordinates F^-1: first the rows of a task, then limits, each with its
// normal and its multiplier. A row of a task whose error counts 1/weight is an equation with a slack,
// (row, sqrt(weight) e_a), which keeps a stiff task well conditioned.
struct Held {
  double normals[kMaxHeld][kMaxHeld];
  double multipliers[kMaxHeld];
  int numbers[kMaxHeld];  // of the limits
  int wide, flat;         // length of a normal; limits with a lesser number are flat
  int count;
  LimitSet mask;  // of the flat limits

  Held(const double (*task)[kMaxLengths], int rows, double weight, int n, int flat)
      : wide(n + rows), flat(flat), count(rows) {
    for (int a = 0; a < rows; ++a) {
      std::memcpy(normals[a], task[a], n * sizeof(double));
      for (int b = 0; b < rows; ++b) normals[a][n + b] = a == b ? std::sqrt(weight) : 0.0;
    }
  }

  // r = (N N^T)^-1 N v, how much of every normal is in v; false when the normals depend on each other.
  bool split(const double* v, double* r) const {
    double gram[kMaxHeld * kMaxHeld];
    for (int a = 0; a < count; ++a) {
      for (int b = 0; b <= a; ++b) gram[a * kMaxHeld + b] = dot(normals[a], normals[b], wide);
      r[a] = dot(normals[a], v, wide);
    }
    if (count == 0) return true;
    if (!factor(gram, count, kMaxHeld)) return false;
    solve_lower(gram, count, kMaxHeld, r);
    solve_upper(gram, count, kMaxHeld, r);
    return true;
  }

  void add(const double* normal, double multiplier, int number) {
    std::memcpy(normals[count], normal, wide * sizeof(double));
    multipliers[count] = multiplier;
    numbers[count++] = number;
    if (number < flat) mask.set(number);
  }

  void drop(int place) {
    if (numbers[place] < flat) mask.reset(numbers[place]);
    --count;
    for (int a = place; a < count; ++a) {
      std::memcpy(normals[a], normals[a + 1], wide * sizeof(double));
      multipliers[a] = multipliers[a + 1];
      numbers[a] = numbers[a + 1];
    }
  }
};

// Add limits to what is held until l + d is feasible, `d` in place: see bounded_step.
template <class Limits>
inline void hold_limits(const double* whiten, const double* at, const Limits& limits, int rows, double excess,
                        int number, Held& held, double* d) {
  const int n = limits.size(), wide = held.wide;
  double trial[kMaxLengths];
  for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
  for (int tried = 0; tried < kLimitsTried; ++tried) {
    double v[kMaxHeld] = {}, added = 0.0;
    limits.normal(trial, number, v);
    solve_lower(whiten, n, kMaxLengths, v);
    for (;;) {
      double r[kMaxHeld], move[kMaxHeld];
      if (!held.split(v, r)) return;
      for (int i = 0; i < wide; ++i) {
        move[i] = v[i];
        for (int a = 0; a < held.count; ++a) move[i] -= held.normals[a][i] * r[a];
      }
      const double gain = dot(move, move, wide);
      // How far the multiplier of this limit can grow: until it is met, or until another one's is 0.
      const double full = gain > 1e-14 * dot(v, v, wide) && held.count < wide ? excess / gain : kInfinity;
      double partial = kInfinity;
      int blocking = -1;
      for (int a = rows; a < held.count; ++a)
        if (r[a] > 0.0 && held.multipliers[a] / r[a] < partial) partial = held.multipliers[a] / r[a], blocking = a;
      const double t = full < partial ? full : partial;
      if (t == kInfinity) return;  // linearly dependent on the held ones: the excess left is rounding
      for (int a = rows; a < held.count; ++a) held.multipliers[a] -= t * r[a];
      added += t;
      if (full < kInfinity) {
        solve_upper(whiten, n, kMaxLengths, move);
        for (int i = 0; i < n; ++i) d[i] -= t * move[i];
        excess -= t * gain;
      }
      if (full <= partial) {
        held.add(v, added, number);
        break;
      }
      held.drop(blocking);
    }
    for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
    excess = limits.worst(trial, held.mask, number);
    if (excess <= kRounding) return;
  }
}

// The best step with l + d feasible, in place, from the best one without limits. `whiten` is the lower Cholesky
// factor of the metric; `task` (may be null) are whitened rows of a task whose error counts 1/weight. `limits` are
// Feasible or TangentLimits. Each is linearised at the present point, so a curved one is met by several tangent planes;
// `cones` (may be null) gets the sum of their multipliers per section.
template <class Limits>
inline void bounded_step(const double* whiten, const double* at, const Limits& limits,
                         const double (*task)[kMaxLengths], int rows, double weight, double* d,
                         double* cones = nullptr) {
  const int n = limits.size();
  double trial[kMaxLengths];
  for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
  int number;
  const double excess = limits.worst(trial, {}, number);
  if (excess <= kRounding) return;
  Held held(task, rows, weight, n, limits.flat());
  hold_limits(whiten, at, limits, rows, excess, number, held, d);
  if (!cones) return;
  for (int a = rows; a < held.count; ++a)
    if (held.numbers[a] >= limits.planes()) cones[held.numbers[a] - limits.planes()] += held.multipliers[a];
}

struct IdentityFactor {
  double entries[kMaxLengths * kMaxLengths] = {};
  IdentityFactor() {
    for (int i = 0; i < kMaxLengths; ++i) entries[i * kMaxLengths + i] = 1.0;
  }
};

// minimise |J d - e|^2 + weight (d^T W d - 2 z^T d) with l + d feasible; y are the multipliers of the task.
// `metric` is the lower Cholesky factor of W; null for the identity. Without limits in the way
//     d = W^-1 (z + J^T y),    (J W^-1 J^T + weight) y = e - J W^-1 z
// which factors a matrix of the size of the task and keeps the digits of the part of z in the null space of J.
inline void damped_step(const Feasible& feasible, const double (*J)[kMaxLengths], const double* e, int rows,
                        double weight, const double* z, const double* at, const double* metric, double* d, double* y) {
  static const IdentityFactor identity;
  const int n = feasible.size();
  double gram[kMaxRows * kMaxRows], K[kMaxRows][kMaxLengths];
  std::memcpy(d, z, n * sizeof(double));
  for (int a = 0; a < rows; ++a) std::memcpy(K[a], J[a], n * sizeof(double));
  if (metric) {
    solve_lower(metric, n, kMaxLengths, d);
    for (int a = 0; a < rows; ++a) solve_lower(metric, n, kMaxLengths, K[a]);
  }
  for (int a = 0; a < rows; ++a) {
    for (int b = 0; b <= a; ++b) gram[a * kMaxRows + b] = dot(K[a], K[b], n);
    gram[a * kMaxRows + a] += weight;
    y[a] = e[a] - dot(K[a], d, n);
  }
  if (factor(gram, rows, kMaxRows)) {
    solve_lower(gram, rows, kMaxRows, y);
    solve_upper(gram, rows, kMaxRows, y);
    for (int a = 0; a < rows; ++a)
      for (int i = 0; i < n; ++i) d[i] += K[a][i] * y[a];
  }
  if (metric) solve_upper(metric, n, kMaxLengths, d);
  bounded_step(metric ? metric : identity.entries, at, feasible, K, rows, weight, d);
}

}  // namespace contid
