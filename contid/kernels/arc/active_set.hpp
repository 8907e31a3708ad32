// The bounded step: a strictly convex quadratic programme over the feasible lengths, by dual active sets
//
//     minimise 1/2 (d - d0)^T H (d - d0) with l + d feasible,    d0 the step without limits
//
// after Goldfarb and Idnani (1983).
//
// It starts at the step without limits, adds the limit exceeded most, and drops limits whose multiplier would change
// sign, until nothing is exceeded. Each limit is linearised at the present point, so a curved one (the cone of the bend
// radius) is met by several tangent planes.
#pragma once

#include "whitened.hpp"
#ifdef CONTID_TENDON
#include "../tendon/feasible.hpp"
#else
#include "tangent_limits.hpp"
#endif

namespace contid::section_build {

// The limits of a step. Of one type, so that the code of a step is compiled once for cones and for tangent planes.
class Limits {
 public:
  // `tangents`: planes in place of the cones; null for the cones themselves. Both have to outlive this.
  Limits(const Feasible& feasible, const TangentLimits* tangents = nullptr)
      : feasible_(feasible), tangents_(tangents) {}

  int size() const { return feasible_.size(); }
  int flat() const { return tangents_ ? feasible_.limits() : planes(); }
  int planes() const { return feasible_.flat(); }  // limits before the cones, or before the planes in their place

  double worst(const double* at, const LimitSet& held, int& number) const {
    return tangents_ ? tangents_->worst(at, held, number) : feasible_.worst(at, held, number);
  }
  void normal(const double* at, int number, double* out) const {
    tangents_ ? tangents_->normal(at, number, out) : feasible_.normal(at, number, out);
  }

 private:
  const Feasible& feasible_;
  const TangentLimits* tangents_;
};

constexpr int kMaxHeld = kMaxLengths + kMaxRows;
constexpr int kLimitsTried = 40;

// What the step is held to, in whitened coordinates F^-1: first the rows of a task, then limits, each with its
// normal and its multiplier. A row of a task whose error counts 1/weight is an equation with a slack,
// (row, sqrt(weight) e_a), which keeps a stiff task well conditioned. Only rows of the task have slacks: they are not
// stored.
struct Held {
  double normals[kMaxHeld][kMaxLengths];
  double multipliers[kMaxHeld];
  int numbers[kMaxHeld];  // of the limits
  int n, rows, flat;      // length of a normal; rows of the task; limits with a lesser number are flat
  int count;
  double slack;
  LimitSet mask;  // of the flat limits

  // `task` may be null, without rows.
  Held(const Whitened* task, int rows, double weight, int n, int flat)
      : n(n), rows(rows), flat(flat), count(rows), slack(std::sqrt(weight)) {
    for (int a = 0; a < rows; ++a) {
      for (int i = 0; i < n; ++i) normals[a][i] = task->row(a, i);
      for (int b = 0; b <= a; ++b) gram_[a][b] = task->gram[a * kMaxRows + b];
      gram_[a][a] += slack * slack;
    }
  }

  bool full() const { return count == n + rows; }

  // in = N v, by normals
  void project(const double* v, double* in) const {
    for (int a = 0; a < count; ++a) in[a] = dot(normals[a], v, n);
  }

  // r = (N N^T)^-1 in; false when the normals depend on each other.
  bool split(const double* in, double* r) {
    for (; factored_ < count; ++factored_)
      if (!factor_row(factored_)) return false;
    for (int a = 0; a < count; ++a) r[a] = in[a];
    solve_lower(&factor_[0][0], count, kMaxHeld, r);
    solve_upper(&factor_[0][0], count, kMaxHeld, r);
    return true;
  }

  // `in` and `size`: N normal and its square.
  void add(const double* normal, const double* in, double size, double multiplier, int number) {
    std::memcpy(normals[count], normal, n * sizeof(double));
    std::memcpy(gram_[count], in, count * sizeof(double));
    gram_[count][count] = size;
    multipliers[count] = multiplier;
    numbers[count++] = number;
    if (number < flat) mask.set(number);
  }

  // `in` loses its entry too.
  void drop(int place, double* in) {
    if (numbers[place] < flat) mask.reset(numbers[place]);
    --count;
    for (int a = place; a < count; ++a) {
      std::memcpy(normals[a], normals[a + 1], n * sizeof(double));
      multipliers[a] = multipliers[a + 1];
      numbers[a] = numbers[a + 1];
      in[a] = in[a + 1];
      std::memcpy(gram_[a], gram_[a + 1], place * sizeof(double));
      for (int b = place; b <= a; ++b) gram_[a][b] = gram_[a + 1][b + 1];
    }
    factored_ = std::min(factored_, place);
  }

 private:
  double gram_[kMaxHeld][kMaxHeld];    // N N^T, the lower triangle
  double factor_[kMaxHeld][kMaxHeld];  // its Cholesky factor
  double inverse_[kMaxHeld];           // of the factor's diagonal
  int factored_ = 0;                   // rows of the factor

  // The same operations as `factor`, row by row: rows that stay are not factored again.
  bool factor_row(int i) {
    double pivot = gram_[i][i];
    for (int j = 0; j < i; ++j) {
      double value = gram_[i][j];
      for (int k = 0; k < j; ++k) value -= factor_[i][k] * factor_[j][k];
      factor_[i][j] = value * inverse_[j];
      pivot -= factor_[i][j] * factor_[i][j];
    }
    if (!(pivot > 0.0)) return false;
    factor_[i][i] = std::sqrt(pivot);
    inverse_[i] = 1.0 / factor_[i][i];
    return true;
  }
};

// Add limits to what is held until l + d is feasible, `d` in place: see bounded_step.
inline void hold_limits(const Factor& whiten, const double* at, const Limits& limits, double excess, int number,
                        Held& held, double* d) {
  const int n = limits.size();
  double trial[kMaxLengths];
  for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
  for (int tried = 0; tried < kLimitsTried; ++tried) {
    double v[kMaxLengths], in[kMaxHeld], added = 0.0;
    limits.normal(trial, number, v);
    whiten.lower(n, v);
    const double size = dot(v, v, n);
    held.project(v, in);
    for (;;) {
      double r[kMaxHeld], move[kMaxLengths];
      if (!held.split(in, r)) return;
      std::memcpy(move, v, n * sizeof(double));
      for (int a = 0; a < held.count; ++a)
        for (int i = 0; i < n; ++i) move[i] -= held.normals[a][i] * r[a];
      double gain = dot(move, move, n);
      for (int a = 0; a < held.rows; ++a) gain += (held.slack * r[a]) * (held.slack * r[a]);
      // How far the multiplier of this limit can grow: until it is met, or until another one's is 0.
      const double full = gain > 1e-14 * size && !held.full() ? excess / gain : kInfinity;
      double partial = kInfinity;
      int blocking = -1;
      for (int a = held.rows; a < held.count; ++a)
        if (r[a] > 0.0 && held.multipliers[a] / r[a] < partial) partial = held.multipliers[a] / r[a], blocking = a;
      const double t = full < partial ? full : partial;
      if (t == kInfinity) return;  // linearly dependent on the held ones: the excess left is rounding
      for (int a = held.rows; a < held.count; ++a) held.multipliers[a] -= t * r[a];
      added += t;
      if (full < kInfinity) {
        whiten.upper(n, move);
        for (int i = 0; i < n; ++i) d[i] -= t * move[i];
        excess -= t * gain;
      }
      if (full <= partial) {
        held.add(v, in, size, added, number);
        break;
      }
      held.drop(blocking, in);
    }
    for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
    excess = limits.worst(trial, held.mask, number);
    if (excess <= kRounding) return;
  }
}

// The best step with l + d feasible, in place, from the best one without limits; false when that is it already.
// `whiten` is the lower Cholesky factor of the metric; `task` (may be null) are whitened rows of a task whose error
// counts 1/weight. Each limit is linearised at the present point, so a curved one is
// met by several tangent planes; `cones` (may be null) gets the sum of their multipliers per section.
inline bool bounded_step(const Factor& whiten, const double* at, const Limits& limits, const Whitened* task, int rows,
                         double weight, double* d, double* cones = nullptr) {
  const int n = limits.size();
  double trial[kMaxLengths];
  for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
  int number;
  const double excess = limits.worst(trial, {}, number);
  if (excess <= kRounding) return false;
  Held held(task, rows, weight, n, limits.flat());
  hold_limits(whiten, at, limits, excess, number, held, d);
  if (!cones) return true;
  for (int a = rows; a < held.count; ++a)
    if (held.numbers[a] >= limits.planes()) cones[held.numbers[a] - limits.planes()] += held.multipliers[a];
  return true;
}

// minimise |J d - e|^2 + weight d^T W d with l + d feasible, W by its factor `metric`. Without limits in the way
//     d = W^-1 J^T y,    (J W^-1 J^T + weight) y = e
// which factors a matrix of the size of the task.
inline void damped_step(const Feasible& feasible, const Column (*J)[kMaxLengths], const double* e, int rows,
                        double weight, const double* at, const Factor& metric, double* d) {
  const int n = feasible.size();
  const double still[kMaxLengths] = {};
  Whitened task;
  with_rows(rows, [&](auto constant) {
    constexpr int kRows = decltype(constant)::value;
    double gram[kMaxRows * kMaxRows], y[kMaxRows];
    task.set<kRows>(J, still, metric, n);
    for (int a = 0; a < kRows; ++a) {
      for (int b = 0; b <= a; ++b) gram[a * kMaxRows + b] = task.gram[a * kMaxRows + b];
      gram[a * kMaxRows + a] += weight;
      y[a] = e[a];
    }
    if (!factor(gram, kRows, kMaxRows)) {
      std::memcpy(d, still, n * sizeof(double));
      return;
    }
    solve_lower(gram, kRows, kMaxRows, y);
    solve_upper(gram, kRows, kMaxRows, y);
    task.combine<kRows>(y, n, d);
  });
  metric.upper(n, d);
  bounded_step(metric, at, feasible, &task, rows, weight, d);
}

}  // namespace contid::section_build
