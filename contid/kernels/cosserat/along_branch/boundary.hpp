// The boundary of the pressures whose path from rest is stable, next to a pose. Beyond it the path leads to another
// equilibrium: the arm would snap. A descent needs the direction in which it lies: at the weakest point of the path,
// that in which pressures turn the base moment most.
#pragma once

#include "../box_step.hpp"
#include "ramp.hpp"

namespace contid {

constexpr double kShrink = 0.25, kLeastApproach = 0.05, kNearlyWeakest = 0.5, kPlaneWeight = 1e4, kDefinite = 1e-13;

// A plane that the next steps must not cross, and the distance that is left in front of it.
struct StableBoundary {
  int n;  // pressures
  double normal[kMost] = {}, room = 0.0;

  double along_normal(const double* d) const {
    double sum = 0.0;
    for (int j = 0; j < n; ++j) sum += normal[j] * d[j];
    return sum;
  }

  // The normal next to a pose; false where there is no such direction.
  bool find_normal(const Rod& rod, const double* pressures, Vec moment, const Judged& end, Vec force, int elements,
                   const Ramp& ramp) {
    double most = squared(end.moment_by_balance), p[kMost];
    for (int k = 0; k < ramp.count; ++k) most = std::fmax(most, squared(ramp.compliance[k]));
    int first = 0;
    while (first < ramp.count && squared(ramp.compliance[first]) < kNearlyWeakest * kNearlyWeakest * most) ++first;
    const Mat& by = first < ramp.count ? ramp.compliance[first] : end.moment_by_balance;
    const double share = first < ramp.count ? ramp.part[first] : 1.0;
    int row = 0;
    double longest = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double size = by.m[i][0] * by.m[i][0] + by.m[i][1] * by.m[i][1] + by.m[i][2] * by.m[i][2];
      if (size > longest) longest = size, row = i;
    }
    for (int j = 0; j < n; ++j) p[j] = share * pressures[j];
    Sweep at;
    sweep(rod, p, first < ramp.count ? ramp.moment[first] : moment, share * force, share, elements, at);
    double length = 0.0;
    for (int j = 0; j < n; ++j) {
      normal[j] = 0.0;
      for (int i = 0; i < 3; ++i) normal[j] += by.m[row][i] * at.residual[i][3 + j];
      length += normal[j] * normal[j];
    }
    length = std::sqrt(length);
    if (!(length > 0.0)) return false;
    for (int j = 0; j < n; ++j) normal[j] /= length;
    return true;
  }

  // Turns the normal towards a step that led across, and leaves a part of it; false where that step runs along the
  // plane.
  bool orient(const double* step) {
    double length = 0.0, along = along_normal(step);
    for (int j = 0; j < n; ++j) length += step[j] * step[j];
    if (along < 0.0) {
      along = -along;
      for (int j = 0; j < n; ++j) normal[j] = -normal[j];
    }
    room = kShrink * along;
    return along > kLeastApproach * std::sqrt(length);
  }

  // The bounded step that uses up the room; false where a step `d` does not need more.
  bool limit(const double (&H)[kMost][kMost], const double* g, const double* low, const double* high, double* d) const {
    if (along_normal(d) <= room) return false;
    double stiff[kMost][kMost], slope[kMost], weight = 0.0;
    for (int j = 0; j < n; ++j) weight += kPlaneWeight * H[j][j];
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) stiff[i][j] = H[i][j] + weight * normal[i] * normal[j];
      stiff[i][i] += kDefinite * weight;
      slope[i] = g[i] - weight * room * normal[i];
    }
    box_step(n, stiff, slope, low, high, d);
    return true;
  }
};

}  // namespace contid
