// Bends of the sections of an arm in equilibrium, and the pressures that have them.
//
// A section under loads is no arc. Its bend is the angle between the tangents at its ends, towards the azimuth of the
// second one in the frame at the first, as two components [rad]; its length [mm] is that of the deformed backbone, of
// kParts pieces that each count as the arc between their ends. Without loads these are the arc that the section is.
//
// Pressures for bends and lengths are solved by Newton's method, with the updates of C. G. Broyden (Math. Comp. 19,
// 1965) as long as they lead on. A length that is left open leaves one pressure of its section open: the mean is as far
// above the lower limit as the pressures swing about it, mean = sqrt(2) deviation, so that they are the lowest with
// which the bend can turn towards any azimuth at one mean.
#pragma once

#include "../lu.hpp"
#include "solver.hpp"

namespace contid {

constexpr int kParts = 6, kStations = kParts + 1, kRounds = 40;
constexpr double kBendStep = 1e-4;     // pressure step of the differences [bar]
constexpr double kMostBendStep = 0.5;  // of a round [bar]
constexpr double kWorth = 0.7;         // a step that leaves more than this share of the error does not lead on
constexpr double kBent = 1e-9;         // error of bends [rad], of lengths by that of the section, of pressures [bar]
constexpr double kAtLimit = 5e-9;      // a pressure this near to its lower limit is at it [bar]

class Bends {
 public:
  explicit Bends(const Arm& arm) : n_(arm.rod.pressures()) {
    double begin = 0.0;
    for (int s = 0; s < arm.rod.count; ++s) {
      const Section& section = arm.rod.sections[s];
      for (int k = 0; k < kStations; ++k) stations_[kStations * s + k] = begin + section.length * k / kParts;
      begin += section.length + section.link;
    }
    double middle[kMost];
    for (int i = 0; i < n_; ++i) middle[i] = 0.5 * (arm.limits.lower[i] + arm.limits.upper[i]);
    slope(arm, middle, {0, 0, 0}, slope_);
  }

  // Two components of the bend and the length of every section; false where the arm has buckled.
  bool read(const Arm& arm, const double* pressures, Vec force, double* out) const {
    const Equilibrium at = arm.forward(arm.rod, pressures, force);
    double frames[kStations * kMostSections * kFrame];
    frames_at(arm.rod, pressures, at.moment, force, at.elements, stations_, kStations * arm.rod.count, frames);
    for (int s = 0; s < arm.rod.count; ++s) one(frames + kStations * kFrame * s, out + 3 * s);
    return at.done == 1.0;
  }

  // Pressures with bends and lengths (0: left open), from those of a start; false where none were found.
  bool solve(const Arm& arm, const double* asked, Vec force, const double* start, double* p) const {
    const int n = n_;
    double slope_now[kMost * kMost], left[kMost], after[kMost];
    std::copy(start, start + n, p);
    for (int i = 0; i < n; ++i) {
      const bool open = i % 3 == 2 && asked[i] == 0.0;
      for (int j = 0; j < n; ++j)
        slope_now[n * i + j] = open ? (j / 3 == i / 3 ? 1.0 / 3.0 : 0.0) : slope_[n * i + j] / scale(arm, i);
    }
    error(arm, asked, force, p, left);
    bool leads = true;
    for (int round = 0; round < kRounds; ++round) {
      if (most(left) < kBent) return finish(arm, force, p);
      if (!leads) {
        for (int j = 0; j < n; ++j) {
          const double before = p[j];
          p[j] += kBendStep;
          error(arm, asked, force, p, after);
          p[j] = before;
          for (int i = 0; i < n; ++i) slope_now[n * i + j] = (after[i] - left[i]) / kBendStep;
        }
      }
      double factors[kMost * kMost], step[kMost], predicted[kMost];
      int order[kMost];
      std::copy(slope_now, slope_now + n * n, factors);
      for (int i = 0; i < n; ++i) step[i] = -left[i];
      if (!factorise_lu(factors, order, n)) return false;
      solve_lu(factors, order, n, step, 1);
      const double part = std::fmin(1.0, kMostBendStep / std::fmax(most(step), kBent));
      double square = 0.0;
      for (int i = 0; i < n; ++i) step[i] *= part, p[i] += step[i], square += step[i] * step[i];
      for (int i = 0; i < n; ++i) {
        predicted[i] = left[i];
        for (int j = 0; j < n; ++j) predicted[i] += slope_now[n * i + j] * step[j];
      }
      error(arm, asked, force, p, after);
      if (!(most(after) < 1e9)) return false;  // NaN is not
      // Where a step does not lead far, the derivatives are computed anew.
      leads = most(after) < kWorth * most(left);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
          slope_now[n * i + j] += (after[i] - predicted[i]) * step[j] / std::fmax(square, 1e-300);
      std::copy(after, after + n, left);
    }
    return false;
  }

 private:
  int n_;
  double stations_[kStations * kMostSections];
  double slope_[kMost * kMost];  // of bends and lengths by pressures, without loads in the middle of the limits

  static double scale(const Arm& arm, int row) { return row % 3 == 2 ? arm.rod.sections[row / 3].length : 1.0; }

  double most(const double* values) const {
    double found = 0.0;
    for (int i = 0; i < n_; ++i) {
      if (!(std::fabs(values[i]) <= 1e300)) return values[i] * 0.0 + 1e301;
      found = std::fmax(found, std::fabs(values[i]));
    }
    return found;
  }

  static void one(const double* frames, double* out) {
    const auto tangent = [&](int k) {
      const double* f = frames + kFrame * k;
      return Vec{f[5], f[8], f[11]};
    };
    const auto place = [&](int k) {
      const double* f = frames + kFrame * k;
      return Vec{f[0], f[1], f[2]};
    };
    Mat first;
    for (int i = 0; i < 9; ++i) first.m[i / 3][i % 3] = frames[3 + i];
    const Vec end = transposed_times(first, tangent(kParts));
    const double across = std::hypot(end.x, end.y);
    const double per_sine = across > 0.0 ? std::atan2(across, end.z) / across : 1.0;
    out[0] = end.x * per_sine, out[1] = end.y * per_sine, out[2] = 0.0;
    for (int k = 0; k < kParts; ++k) {
      const double half = 0.5 * norm(tangent(k + 1) - tangent(k));
      out[2] += norm(place(k + 1) - place(k)) * (half > 0.0 ? std::asin(std::fmin(half, 1.0)) / half : 1.0);
    }
  }

  void error(const Arm& arm, const double* asked, Vec force, const double* p, double* out) const {
    read(arm, p, force, out);
    for (int i = 0; i < n_; ++i) {
      if (i % 3 != 2 || asked[i] != 0.0) {
        out[i] = (out[i] - asked[i]) / scale(arm, i);
        continue;
      }
      const double *own = p + i - 2, *least = arm.limits.lower + i - 2;
      double mean = 0.0, square = 0.0;
      for (int k = 0; k < 3; ++k) mean += (own[k] - least[k]) / 3.0;
      for (int k = 0; k < 3; ++k) square += (own[k] - least[k] - mean) * (own[k] - least[k] - mean) / 3.0;
      out[i] = mean - std::sqrt(2.0 * square);
    }
  }

  void slope(const Arm& arm, const double* at, Vec force, double* out) const {
    double here[kMost], there[kMost], moved[kMost];
    std::copy(at, at + n_, moved);
    read(arm, moved, force, here);
    for (int j = 0; j < n_; ++j) {
      moved[j] = at[j] + kBendStep;
      read(arm, moved, force, there);
      moved[j] = at[j];
      for (int i = 0; i < n_; ++i) out[n_ * i + j] = (there[i] - here[i]) / kBendStep;
    }
  }

  bool finish(const Arm& arm, Vec force, double* p) const {
    for (int i = 0; i < n_; ++i)
      if (std::fabs(p[i] - arm.limits.lower[i]) < kAtLimit) p[i] = arm.limits.lower[i];
    return arm.forward(arm.rod, p, force).done == 1.0;
  }
};

}  // namespace contid
