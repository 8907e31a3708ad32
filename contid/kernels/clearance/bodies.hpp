// Bounds of the distance of two swept curves, by branch and bound. Units: m.
//
// A node is a range of samples of a body, bounded by its chord and an allowance
// (extras/clearance/contid_clearance/body.py). Pairs of nodes whose lower bound exceeds the best upper bound are
// dropped, the others are halved down to single pieces. The result holds for the curves between the samples, not only
// for the samples.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace contid {

// A curve by points at equal arc length.
struct Curve {
  const double* points;  // x, y, z
  int pieces;            // one less than points
  double spacing;        // arc length between neighbours

  const double* at(int k) const { return points + 3 * k; }

  // Greatest distance of the curve between two samples from their chord, whose square is `chord`.
  double allowance(int count, double chord) const {
    const double along = count * spacing;
    return 0.5 * std::sqrt(std::max(along * along - chord, 0.0));
  }
};

// Bounds of a distance [m], and where it is least on either curve: 2 k at point k, 2 k + 1 on the piece after it.
struct Bounds {
  double lower, upper;
  int at, other_at;
};

inline double clamped(double x) { return std::min(std::max(x, 0.0), 1.0); }

inline double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Distance of the segments p + s u and q + t v; also their squared lengths.
inline double segments(const double* p, const double* p_end, const double* q, const double* q_end, double& uu,
                       double& vv) {
  double u[3], v[3], r[3];
  for (int i = 0; i < 3; ++i) u[i] = p_end[i] - p[i], v[i] = q_end[i] - q[i], r[i] = p[i] - q[i];
  uu = dot(u, u), vv = dot(v, v);
  constexpr double tiny = std::numeric_limits<double>::min();
  const double uv = dot(u, v), ur = dot(u, r), vr = dot(v, r), rr = dot(r, r);
  const double by_u = 1.0 / std::max(uu, tiny), by_v = 1.0 / std::max(vv, tiny);
  // |r + s u - t v|^2, where no digits are lost: at the ends of one segment and at the crossing of the lines.
  const auto squared = [&](double s, double t) {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double apart = r[i] + s * u[i] - t * v[i];
      sum += apart * apart;
    }
    return sum;
  };
  double s = clamped((uv * vr - vv * ur) / std::max(uu * vv - uv * uv, tiny));
  const double t = clamped((uv * s + vr) * by_v);
  s = clamped((uv * t - ur) * by_u);
  double least = std::min(squared(s, t), rr);
  least = std::min(least, squared(clamped(-ur * by_u), 0.0));
  least = std::min(least, squared(clamped((uv - ur) * by_u), 1.0));
  least = std::min(least, squared(0.0, clamped(vr * by_v)));
  least = std::min(least, squared(1.0, clamped((uv + vr) * by_v)));
  return std::sqrt(least);
}

// A pair of ranges of samples, and the bounds of its distance.
struct Pair {
  int a0, a1, b0, b1;
  double lower;

  bool leaf() const { return a1 - a0 == 1 && b1 - b0 == 1; }
};

// The distance of two curves; halving stops as soon as it is certainly `enough`. Of one curve to itself, `gap` is the
// number of pieces that its two points are apart at least; pairs of pieces are counted in as soon as a part of them is.
inline Bounds between(const Curve& a, const Curve& b, double enough, int gap = std::numeric_limits<int>::min() / 2) {
  constexpr double rounding = 1e-12;
  thread_local std::vector<Pair> level, next;
  Bounds found{0.0, std::numeric_limits<double>::infinity(), 0, 0};
  const auto add = [&](int a0, int a1, int b0, int b1) {
    if (b1 - a0 < gap) return;
    double aa, bb;
    const double apart = segments(a.at(a0), a.at(a1), b.at(b0), b.at(b1), aa, bb);
    const double slack = a.allowance(a1 - a0, aa) + b.allowance(b1 - b0, bb);
    if (b0 - a1 >= gap) found.upper = std::min(found.upper, apart + slack);
    // The bound only falls: what is beyond it already is dropped now.
    if (apart - slack <= found.upper + rounding) next.push_back({a0, a1, b0, b1, apart - slack});
  };
  next.clear();
  add(0, a.pieces, 0, b.pieces);
  while (true) {
    level.swap(next);
    next.clear();
    const Pair* nearest = level.data();
    bool leaves = true;
    for (const Pair& pair : level) {
      if (pair.lower < nearest->lower) nearest = &pair;
      leaves = leaves && (pair.leaf() || pair.lower > found.upper + rounding);
    }
    if (nearest->lower >= enough || leaves) {
      found.lower = nearest->lower;
      found.at = nearest->a0 + nearest->a1, found.other_at = nearest->b0 + nearest->b1;
      return found;
    }
    for (const Pair& pair : level) {
      if (pair.lower > found.upper + rounding) continue;
      if (pair.leaf()) {
        next.push_back(pair);
        continue;
      }
      const int a_mid = (pair.a0 + pair.a1) / 2, b_mid = (pair.b0 + pair.b1) / 2;
      const bool halve_a = pair.a1 - pair.a0 > 1, halve_b = pair.b1 - pair.b0 > 1;
      const int a_ends[3] = {pair.a0, halve_a ? a_mid : pair.a1, pair.a1};
      const int b_ends[3] = {pair.b0, halve_b ? b_mid : pair.b1, pair.b1};
      for (int i = 0; i < 1 + halve_a; ++i)
        for (int j = 0; j < 1 + halve_b; ++j) add(a_ends[i], a_ends[i + 1], b_ends[j], b_ends[j + 1]);
    }
  }
}

}  // namespace contid
