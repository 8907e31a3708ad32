// The convex set of feasible lengths, and the bounded step: a quadratic programme by dual active sets.
// Twin and specification: contid/models/feasible.py and contid/models/active_set.py.
#pragma once

#include <cstdint>
#include <limits>

#include "arc.hpp"

namespace contid {

constexpr int kMostRows = 9;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Feasible {
  Sections sections;
  double low[kMostLengths], high[kMostLengths], home[kMostLengths];
  double metric[kMostLengths * kMostLengths];  // what counts as far from home
  double rack = kInfinity;           // greatest sum of one rack's lengths [m]
  double curvature_max = kInfinity;  // [1/m]

  int size() const { return sections.size(); }
  int flat() const { return 2 * size() + 3; }  // limits before the cones
  int limits() const { return flat() + sections.count; }

  // No tip is farther from the base than this.
  double longest() const {
    double sum = 0.0, rigid = 0.0;
    for (int s = 0; s < sections.count; ++s) sum += high[3 * s], rigid += sections.rigid[s];
    return std::fmin(sum, rack) + rigid;
  }

  double rack_excess(const double* l, int j) const {
    double sum = 0.0;
    for (int i = j; i < size(); i += 3) sum += l[i];
    return sum - rack;
  }

  double bend_excess(const double* l, int s) const {
    if (curvature_max == kInfinity) return -kInfinity;
    double uvl[3];
    sections.arc(l, s, uvl);
    return sections.radius[s] * (std::hypot(uvl[0], uvl[1]) - curvature_max * uvl[2]);
  }

  double excess(const double* l, int number) const {
    const int n = size();
    if (number < n) return low[number] - l[number];
    if (number < 2 * n) return l[number - n] - high[number - n];
    if (number < flat()) return rack_excess(l, number - 2 * n);
    return bend_excess(l, number - flat());
  }

  // The limit exceeded most; flat ones whose bit is set in `held` are left out.
  double worst(const double* l, std::uint64_t held, int& number) const {
    double most = -kInfinity;
    number = 0;
    const int n = size();
    for (int i = 0; i < n; ++i) {
      const double below = low[i] - l[i];
      if (below > most && !(held >> i & 1)) most = below, number = i;
    }
    for (int i = 0; i < n; ++i) {
      const double above = l[i] - high[i];
      if (above > most && !(held >> (n + i) & 1)) most = above, number = n + i;
    }
    if (rack < kInfinity)
      for (int j = 0; j < 3; ++j) {
        const double over = rack_excess(l, j);
        if (over > most && !(held >> (2 * n + j) & 1)) most = over, number = 2 * n + j;
      }
    if (curvature_max < kInfinity)
      for (int s = 0; s < sections.count; ++s) {
        const double over = bend_excess(l, s);
        if (over > most) most = over, number = flat() + s;
      }
    return most;
  }

  void normal(const double* l, int number, double* out) const {
    const int n = size();
    for (int i = 0; i < n; ++i) out[i] = 0.0;
    if (number < n) {
      out[number] = -1.0;
    } else if (number < 2 * n) {
      out[number - n] = 1.0;
    } else if (number < flat()) {
      for (int i = number - 2 * n; i < n; i += 3) out[i] = 1.0;
    } else {
      const int s = number - flat();
      double uvl[3];
      sections.arc(l, s, uvl);
      double theta = std::hypot(uvl[0], uvl[1]);
      if (theta == 0.0) theta = 1.0;
      const double along[3] = {uvl[0] / theta, uvl[1] / theta, -curvature_max};
      const double* m = sections.to_arc[s];
      for (int j = 0; j < 3; ++j)
        out[3 * s + j] = sections.radius[s] * (along[0] * m[j] + along[1] * m[3 + j] + along[2] * m[6 + j]);
    }
  }

  // metric: 3 (L - L0)^2 + max(1.5 d^2, L0^2/2) theta^2 per section.
  void weigh_home() {
    for (double& entry : metric) entry = 0.0;
    for (int s = 0; s < sections.count; ++s) {
      const double d = sections.radius[s], L = home[3 * s];
      const double bend = std::fmax(1.5 * d * d, 0.5 * L * L);
      const double* m = sections.to_arc[s];
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          metric[(3 * s + i) * kMostLengths + 3 * s + j] =
              bend * (m[i] * m[j] + m[3 + i] * m[3 + j]) + 3.0 * m[6 + i] * m[6 + j];
    }
  }

  // Bits of the limits that have less than 1 nm left.
  std::uint64_t binding(const double* l) const {
    std::uint64_t bits = 0;
    for (int k = 0; k < limits(); ++k)
      if (excess(l, k) > -1e-9) bits |= std::uint64_t{1} << k;
    return bits;
  }

  void clip(double* l) const {
    for (int i = 0; i < size(); ++i) l[i] = l[i] < low[i] ? low[i] : l[i] > high[i] ? high[i] : l[i];
  }

  // Bring l inside: clip it to its intervals, then pull it towards home as far as the other limits ask.
  void pull(double* l) const {
    clip(l);
    if (rack == kInfinity && curvature_max == kInfinity) return;
    double share = 1.0;
    for (int k = 2 * size(); k < limits(); ++k) {
      const double there = excess(l, k);
      if (there > 0.0) {
        const double here = excess(home, k);
        const double reach = here / (here - there);
        if (reach < share) share = reach;
      }
    }
    if (share == 1.0) return;
    for (int i = 0; i < size(); ++i) l[i] = home[i] + share * (l[i] - home[i]);
    clip(l);
  }
};

// Lower Cholesky factor in place (row-major, `stride` columns) and the two triangular solves.
inline bool factor(double* a, int n, int stride) {
  for (int j = 0; j < n; ++j) {
    double* row_j = a + j * stride;
    double pivot = row_j[j];
    for (int k = 0; k < j; ++k) pivot -= row_j[k] * row_j[k];
    if (!(pivot > 0.0)) return false;
    row_j[j] = std::sqrt(pivot);
    const double inverse = 1.0 / row_j[j];
    for (int i = j + 1; i < n; ++i) {
      double* row_i = a + i * stride;
      double value = row_i[j];
      for (int k = 0; k < j; ++k) value -= row_i[k] * row_j[k];
      row_i[j] = value * inverse;
    }
  }
  return true;
}

inline void solve_lower(const double* f, int n, int stride, double* x) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= f[i * stride + k] * x[k];
    x[i] /= f[i * stride + i];
  }
}

inline void solve_upper(const double* f, int n, int stride, double* x) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= f[k * stride + i] * x[k];
    x[i] /= f[i * stride + i];
  }
}

struct IdentityFactor {
  double entries[kMostLengths * kMostLengths] = {};
  IdentityFactor() {
    for (int i = 0; i < kMostLengths; ++i) entries[i * kMostLengths + i] = 1.0;
  }
};

inline double dot(const double* a, const double* b, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

constexpr double kRounding = 1e-12;  // excess that counts as rounding [m]

// The best step with l + d feasible, in place, from the best one without limits; `whiten` is the lower Cholesky
// factor of the metric. `task` (may be null) are whitened rows of a task whose error counts 1/weight: each is
// held as an equation with a slack, (row, sqrt(weight) e_a), so a stiff task brings no large numbers.
// Goldfarb and Idnani, with the limits asked for one by one at the present point.
inline void bounded_step(const double* whiten, const double* at, const Feasible& feasible,
                         const double (*task)[kMostLengths], int rows, double weight, double* d) {
  constexpr int kMost = kMostLengths + kMostRows;
  const int n = feasible.size(), wide = n + rows;
  double trial[kMostLengths];
  for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
  int number;
  double excess = feasible.worst(trial, 0, number);
  if (excess <= kRounding) return;
  double normals[kMost][kMost];  // of what is held, whitened: first the task, then limits
  for (int a = 0; a < rows; ++a) {
    std::memcpy(normals[a], task[a], n * sizeof(double));
    for (int b = 0; b < rows; ++b) normals[a][n + b] = a == b ? std::sqrt(weight) : 0.0;
  }
  double multipliers[kMost];
  int numbers[kMost];
  int held = rows;
  std::uint64_t mask = 0;
  for (int tried = 0; tried < 40; ++tried) {
    double v[kMost] = {}, added = 0.0;
    feasible.normal(trial, number, v);
    solve_lower(whiten, n, kMostLengths, v);
    for (;;) {
      double gram[kMost * kMost], r[kMost], move[kMost];
      for (int a = 0; a < held; ++a) {
        for (int b = 0; b <= a; ++b) gram[a * kMost + b] = dot(normals[a], normals[b], wide);
        r[a] = dot(normals[a], v, wide);
      }
      if (held > 0) {
        if (!factor(gram, held, kMost)) return;
        solve_lower(gram, held, kMost, r);
        solve_upper(gram, held, kMost, r);
      }
      for (int i = 0; i < wide; ++i) {
        move[i] = v[i];
        for (int a = 0; a < held; ++a) move[i] -= normals[a][i] * r[a];
      }
      const double gain = dot(move, move, wide);
      const double full = gain > 1e-14 * dot(v, v, wide) && held < wide ? excess / gain : kInfinity;
      double partial = kInfinity;
      int blocking = -1;
      for (int a = rows; a < held; ++a)
        if (r[a] > 0.0 && multipliers[a] / r[a] < partial) partial = multipliers[a] / r[a], blocking = a;
      const double t = full < partial ? full : partial;
      if (t == kInfinity) return;  // depends on what is held: what is left of it is rounding
      for (int a = rows; a < held; ++a) multipliers[a] -= t * r[a];
      added += t;
      if (full < kInfinity) {
        solve_upper(whiten, n, kMostLengths, move);
        for (int i = 0; i < n; ++i) d[i] -= t * move[i];
        excess -= t * gain;
      }
      if (full <= partial) {
        std::memcpy(normals[held], v, wide * sizeof(double));
        multipliers[held] = added;
        numbers[held++] = number;
        if (number < feasible.flat()) mask |= std::uint64_t{1} << number;
        break;
      }
      if (numbers[blocking] < feasible.flat()) mask &= ~(std::uint64_t{1} << numbers[blocking]);
      --held;
      for (int a = blocking; a < held; ++a) {
        std::memcpy(normals[a], normals[a + 1], wide * sizeof(double));
        multipliers[a] = multipliers[a + 1];
        numbers[a] = numbers[a + 1];
      }
    }
    for (int i = 0; i < n; ++i) trial[i] = at[i] + d[i];
    excess = feasible.worst(trial, mask, number);
    if (excess <= kRounding) return;
  }
}

// minimise |J d - e|^2 + weight (d^T W d - 2 z^T d) with l + d feasible; y are the multipliers of the task.
// `metric` is the lower Cholesky factor of W; null for the identity.
inline void damped_step(const Feasible& feasible, const double (*J)[kMostLengths], const double* e, int rows,
                        double weight, const double* z, const double* at, const double* metric, double* d,
                        double* y) {
  static const IdentityFactor identity;
  const int n = feasible.size();
  double gram[kMostRows * kMostRows], K[kMostRows][kMostLengths];
  std::memcpy(d, z, n * sizeof(double));
  for (int a = 0; a < rows; ++a) std::memcpy(K[a], J[a], n * sizeof(double));
  if (metric) {
    solve_lower(metric, n, kMostLengths, d);
    for (int a = 0; a < rows; ++a) solve_lower(metric, n, kMostLengths, K[a]);
  }
  for (int a = 0; a < rows; ++a) {
    for (int b = 0; b <= a; ++b) gram[a * kMostRows + b] = dot(K[a], K[b], n);
    gram[a * kMostRows + a] += weight;
    y[a] = e[a] - dot(K[a], d, n);
  }
  if (factor(gram, rows, kMostRows)) {
    solve_lower(gram, rows, kMostRows, y);
    solve_upper(gram, rows, kMostRows, y);
    for (int a = 0; a < rows; ++a)
      for (int i = 0; i < n; ++i) d[i] += K[a][i] * y[a];
  }
  if (metric) solve_upper(metric, n, kMostLengths, d);
  bounded_step(metric ? metric : identity.entries, at, feasible, K, rows, weight, d);
}

}  // namespace contid
