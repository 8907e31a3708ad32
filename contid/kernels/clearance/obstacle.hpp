// Bounds of the distance of a swept curve from a convex obstacle: along a curve it changes at most as fast as the arc
// length, and along a chord it is convex. The obstacles are those of extras/clearance/contid_clearance/obstacles.py.
// Units: m.
#pragma once

#include "bodies.hpp"

namespace contid {

// A convex obstacle by its signed distance; each kind uses a part of the numbers.
struct Obstacle {
  enum Kind { kPlane, kCapsule, kBox } kind;
  double point[3];     // on the plane, start of the axis, centre
  double vector[3];    // normal, axis from start to end, half sizes
  double rotation[9];  // box to world, row-major
  double radius;       // of a capsule

  // From kind, point, vector, rotation and radius.
  explicit Obstacle(const double* packed) : kind(static_cast<Kind>(static_cast<int>(packed[0]))), radius(packed[16]) {
    std::copy(packed + 1, packed + 4, point);
    std::copy(packed + 4, packed + 7, vector);
    std::copy(packed + 7, packed + 16, rotation);
  }

  double distance(const double* p) const {
    const double r[3] = {p[0] - point[0], p[1] - point[1], p[2] - point[2]};
    if (kind == kPlane) return dot(r, vector);
    if (kind == kCapsule) {
      const double squared = dot(vector, vector), along = squared == 0.0 ? 0.0 : clamped(dot(r, vector) / squared);
      const double off[3] = {r[0] - along * vector[0], r[1] - along * vector[1], r[2] - along * vector[2]};
      return std::sqrt(dot(off, off)) - radius;
    }
    double outside = 0.0, most = -std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      const double over = std::fabs(r[0] * rotation[i] + r[1] * rotation[3 + i] + r[2] * rotation[6 + i]) - vector[i];
      outside += std::max(over, 0.0) * std::max(over, 0.0);
      most = std::max(most, over);
    }
    return std::sqrt(outside) + std::min(most, 0.0);
  }

  // Gradient of the distance: a unit vector, 0 where there is none.
  void outwards(const double* p, double* out) const {
    const double r[3] = {p[0] - point[0], p[1] - point[1], p[2] - point[2]};
    if (kind == kPlane) {
      std::copy(vector, vector + 3, out);
      return;
    }
    if (kind == kCapsule) {
      const double squared = dot(vector, vector), along = squared == 0.0 ? 0.0 : clamped(dot(r, vector) / squared);
      for (int i = 0; i < 3; ++i) out[i] = r[i] - along * vector[i];
    } else {
      double local[3], over[3];
      for (int i = 0; i < 3; ++i) {
        local[i] = r[0] * rotation[i] + r[1] * rotation[3 + i] + r[2] * rotation[6 + i];
        over[i] = std::fabs(local[i]) - vector[i];
      }
      const double most = std::max(over[0], std::max(over[1], over[2]));
      bool face = false;  // inside, only the nearest face counts
      for (int i = 0; i < 3; ++i) {
        const bool mine = !face && over[i] == most;
        over[i] = most > 0.0 ? std::max(over[i], 0.0) : mine ? 1.0 : 0.0;
        face = face || mine;
        if (local[i] < 0.0) over[i] = -over[i];
      }
      for (int i = 0; i < 3; ++i)
        out[i] = rotation[3 * i] * over[0] + rotation[3 * i + 1] * over[1] + rotation[3 * i + 2] * over[2];
    }
    const double size = std::sqrt(dot(out, out));
    for (int i = 0; i < 3; ++i) out[i] = size > 0.0 ? out[i] / size : 0.0;
  }

  // Least distance on a chord and the error of it; convex along it, so golden section finds it.
  double least(const double* start, const double* end, double& error) const {
    constexpr double golden = 0.61803398874989484820;
    constexpr int steps = 30;
    double low = 0.0, high = 1.0;
    const auto value = [&](double t) {
      double p[3];
      for (int i = 0; i < 3; ++i) p[i] = start[i] + t * (end[i] - start[i]);
      return distance(p);
    };
    double found = std::min(value(low), value(high));
    double left = high - golden, right = low + golden, at_left = value(left), at_right = value(right);
    for (int k = 0; k < steps; ++k) {
      found = std::min(found, std::min(at_left, at_right));
      if (at_left <= at_right) {
        high = right, right = left, at_right = at_left;
        left = high - golden * (high - low), at_left = value(left);
      } else {
        low = left, left = right, at_left = at_right;
        right = low + golden * (high - low), at_right = value(right);
      }
    }
    const double chord[3] = {end[0] - start[0], end[1] - start[1], end[2] - start[2]};
    error = (high - low) * std::sqrt(dot(chord, chord));
    return found;
  }
};

// The distance of a curve from an obstacle; it stops as soon as it is certainly `enough`.
inline Bounds to_obstacle(const Curve& curve, const Obstacle& obstacle, double enough) {
  thread_local std::vector<double> values;
  values.resize(static_cast<std::size_t>(curve.pieces) + 1);
  Bounds found{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 0, 0};
  for (int k = 0; k <= curve.pieces; ++k) {
    values[k] = obstacle.distance(curve.at(k));
    found.upper = std::min(found.upper, values[k]);
  }
  // The distance changes at most as fast as the arc length.
  for (int k = 0; k < curve.pieces; ++k) {
    const double lower = 0.5 * (values[k] + values[k + 1] - curve.spacing);
    if (lower < found.lower) found.lower = lower, found.at = 2 * k + 1;
  }
  if (found.lower >= enough) return found;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < curve.pieces; ++k) {
    double lower = 0.5 * (values[k] + values[k + 1] - curve.spacing);
    if (lower > found.upper) continue;  // not the nearest piece
    double error, chord = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double each = curve.at(k + 1)[i] - curve.at(k)[i];
      chord += each * each;
    }
    const double on_chord = obstacle.least(curve.at(k), curve.at(k + 1), error);
    const double slack = curve.allowance(1, chord);
    lower = std::max(lower, on_chord - slack - error);
    found.upper = std::min(found.upper, on_chord + slack);
    if (lower < least) least = lower, found.at = 2 * k + 1;
  }
  found.lower = least;
  return found;
}

}  // namespace contid
