// The point of the boundary of a finger's limits whose tip is nearest to a goal out of reach: branch and bound over the
// local minima of the distance. The boundary is that of contid/kinematics/rack/finger_limits.py: two curves and an
// edge, each over a parameter from 0 to 1.
//
// Between two samples of the boundary a tip can move by a third of the finger's length, so the nearest sample need not
// be next to the nearest point. Every local minimum of the samples is refined, unless its lower bound exceeds the best
// distance found.
#pragma once

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "finger.hpp"

namespace contid {

class Boundary {
 public:
  // `pieces`: samples of the parameter, two or more in each piece without a corner of any curve.
  Boundary(const Finger& finger, std::vector<std::vector<double>> pieces)
      : finger_(finger), least_(std::max(finger.arc_length_min, finger.length_min)), pieces_(std::move(pieces)) {
    std::size_t samples = 0;
    for (const auto& piece : pieces_) samples = std::max(samples, piece.size());
    away_.resize(samples), least_away_.resize(samples), tips_.resize(2 * samples);
    for (const auto& piece : pieces_) brackets_.reserve(brackets_.capacity() + kCurves * piece.size());
  }

  // Racks of the point nearest to (x, y); ties go to the first curve, NaN to the first sample.
  void nearest(double x, double y, double* racks) {
    brackets_.clear();
    for (int curve = 0; curve < kCurves; ++curve)
      for (const auto& piece : pieces_) bracket(curve, piece, x, y);
    std::sort(brackets_.begin(), brackets_.end());
    if (brackets_.empty()) return at(0, pieces_.front().front(), racks);
    std::tuple<double, int, double> best{std::get<0>(brackets_[0]), std::get<1>(brackets_[0]),
                                         std::get<2>(brackets_[0])};
    for (const auto& [distance, curve, sample, low, high, lower_bound] : brackets_) {
      if (!(lower_bound < std::get<0>(best))) continue;
      const double u = refined(curve, low, high, x, y);
      best = std::min(best, {away(curve, u, x, y), curve, u});
    }
    at(std::get<1>(best), std::get<2>(best), racks);
  }

 private:
  static constexpr int kCurves = 3;
  // Golden section shrinks by 0.618 a step; the distance is flat at its minimum, so half the bits are enough.
  static constexpr int kGoldenSteps = 40;
  // Path of the tip between two samples over its chord; 1.2 is that of an arc of two radians.
  static constexpr double kDetour = 1.2;

  // A sample nearer to the goal than its neighbours: its distance, curve and parameter, those of its neighbours, and
  // a lower bound of the distance between these.
  using Bracket = std::tuple<double, int, double, double, double, double>;

  void at(int curve, double u, double* racks) const {
    const double s = curve == 2 ? least_ : least_ + u * (finger_.length_max - least_);
    const double bound = finger_.curvature_bound(s);
    const double commanded = curve == 0 ? bound : curve == 1 ? -bound : (2.0 * u - 1.0) * bound;
    const double bend = 0.5 * finger_.spacing * commanded * s;
    racks[0] = std::min(std::max(s - bend, finger_.length_min), finger_.length_max);
    racks[1] = std::min(std::max(s + bend, finger_.length_min), finger_.length_max);
  }

  void tip(int curve, double u, double* xy) const {
    double racks[2], direction[2];
    at(curve, u, racks);
    finger_.forward(racks, xy, direction);
  }

  double away(int curve, double u, double x, double y) const {
    double xy[2];
    tip(curve, u, xy);
    return hypot(xy[0] - x, xy[1] - y);
  }

  void bracket(int curve, const std::vector<double>& samples, double x, double y) {
    const std::size_t last = samples.size() - 1;
    for (std::size_t i = 0; i <= last; ++i) {
      double* const here = &tips_[2 * i];
      tip(curve, samples[i], here);
      away_[i] = hypot(here[0] - x, here[1] - y);
      // Between two samples no point is nearer than this.
      if (i > 0)
        least_away_[i - 1] = 0.5 * (away_[i - 1] + away_[i] - kDetour * hypot(here[-2] - here[0], here[-1] - here[1]));
    }
    for (std::size_t i = 0; i <= last; ++i) {
      const std::size_t before = i == 0 ? 0 : i - 1, after = std::min(i + 1, last);
      // A plateau counts once.
      if (!((i == 0 || away_[i] < away_[before]) && away_[i] <= away_[after])) continue;
      const double least = *std::min_element(&least_away_[before], &least_away_[before] + (after - before));
      brackets_.emplace_back(away_[i], curve, samples[i], samples[before], samples[after], least);
    }
  }

  // Parameter of the point of a curve nearest to (x, y) between two others.
  double refined(int curve, double low, double high, double x, double y) const {
    const double golden = (std::sqrt(5.0) - 1.0) / 2.0;
    double a = high - golden * (high - low), b = low + golden * (high - low);
    double at_a = away(curve, a, x, y), at_b = away(curve, b, x, y);
    for (int step = 0; step < kGoldenSteps; ++step) {
      if (at_a < at_b) {
        high = b, b = a, at_b = at_a;
        a = high - golden * (high - low), at_a = away(curve, a, x, y);
      } else {
        low = a, a = b, at_a = at_b;
        b = low + golden * (high - low), at_b = away(curve, b, x, y);
      }
    }
    return 0.5 * (low + high);
  }

  Finger finger_;
  double least_;
  std::vector<std::vector<double>> pieces_;
  std::vector<double> away_, least_away_, tips_;
  std::vector<Bracket> brackets_;
};

}  // namespace contid
