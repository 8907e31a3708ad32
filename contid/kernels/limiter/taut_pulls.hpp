// Pulls q of tendons as bends of the sections and tightness of their tendons: contid/kinematics/tendon/taut.py has the
// meaning, tension.py the equations. With tensions tau = tau0 + k (q - G Theta), bends Theta = B q, the tensions D
// Theta that hold them, floor f and tensions n that do not bend:
//
//     tightness of a section      lambda = min over its tendons of (tau - f) / n
//     pulls of both               q = G Theta + (D Theta + (max((f - D Theta) / n) + lambda) n - tau0) / k
//
// and what is left of the pulls neither bends nor tightens.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "../arc/cholesky.hpp"

namespace contid {

constexpr int kMostTendons = 64;
constexpr int kMostCoordinates = 3 * kMostTendons + kMostTendons;

using Pulls = double[kMostTendons];
using Coordinates = double[kMostCoordinates];

struct TautPulls {
  int tendons, sections;
  double floor_n, limit_n;
  std::vector<int> section_of;
  std::vector<double> slack_free, rest_n, n_per_m;          // n, tau0 [N] and k [N/m] per tendon
  std::vector<double> demand, pull_matrix, bends_by_pulls;  // D and G (tendons, 2 sections), B (2 sections, tendons)
  std::vector<double> variables_by_pulls, bend_max_m;       // of the solver; largest bend times length per section

  int coordinates() const { return 3 * sections + tendons; }
  int limits() const { return 4 * tendons + sections; }

  // Coordinates of pulls: two bends and, behind those of all sections, one tightness [N] per section; then what is
  // left.
  void split(const double* pulls, double* out) const {
    const int bends = 2 * sections;
    for (int i = 0; i < bends; ++i) out[i] = dot(&bends_by_pulls[i * tendons], pulls, tendons);
    tightness(pulls, out, out + bends);
    Pulls held;
    pulls_of(out, out + bends, held);
    for (int t = 0; t < tendons; ++t) out[3 * sections + t] = pulls[t] - held[t];
  }

  // Pulls of coordinates: the inverse of `split`.
  void join(const double* at, double* pulls) const {
    pulls_of(at, at + 2 * sections, pulls);
    for (int t = 0; t < tendons; ++t) pulls[t] += at[3 * sections + t];
  }

  // lambda of every section [N] of pulls whose bends are known.
  void tightness(const double* pulls, const double* bends, double* out) const {
    std::fill_n(out, sections, std::numeric_limits<double>::infinity());
    for (int t = 0; t < tendons; ++t) {
      double& least = out[section_of[t]];
      least = std::min(least, (tension(pulls, bends, t) - floor_n) / slack_free[t]);
    }
  }

  // Pulls of the same bends with at least this tightness per section [N].
  void tightened(const double* pulls, const double* least, double* out) const {
    Coordinates at;
    split(pulls, at);
    for (int t = 0; t < tendons; ++t) {
      const int s = section_of[t];
      out[t] = pulls[t] + std::max(least[s] - at[2 * sections + s], 0.0) * slack_free[t] / n_per_m[t];
    }
  }

  // Pulls of the same bends whose tensions stand farther above the floor: the tightness of a section grows by
  //
  //     width (1 + ln sum_t exp((lack_t - max lack) / width)),        lack_t = (f - D Theta)_t / n_t
  //
  // between `width` and `width` times 1 + ln of its tendons [N]. The maximum of what lacks, which has a corner where
  // another tendon of the section becomes the slackest, is a smooth function so, and corners may be rounded. It is
  // less where tension or travel have no room.
  void lifted(const double* pulls, const double* upper, double width, double* out) const {
    const int bends = 2 * sections;
    double at[2 * kMostTendons];
    Pulls lacks, most, sum, extra;
    for (int i = 0; i < bends; ++i) at[i] = dot(&bends_by_pulls[i * tendons], pulls, tendons);
    std::fill_n(most, sections, -std::numeric_limits<double>::infinity()), std::fill_n(sum, sections, 0.0);
    for (int t = 0; t < tendons; ++t) {
      lacks[t] = (floor_n - dot(&demand[t * bends], at, bends)) / slack_free[t];
      most[section_of[t]] = std::max(most[section_of[t]], lacks[t]);
    }
    for (int t = 0; t < tendons; ++t) sum[section_of[t]] += std::exp((lacks[t] - most[section_of[t]]) / width);
    for (int s = 0; s < sections; ++s) extra[s] = width * (1.0 + std::log(sum[s]));
    for (int t = 0; t < tendons; ++t) {
      const double room = std::min(limit_n - tension(pulls, at, t), (upper[t] - pulls[t]) * n_per_m[t]);
      extra[section_of[t]] = std::min(extra[section_of[t]], std::max(room / slack_free[t], 0.0));
    }
    for (int t = 0; t < tendons; ++t) out[t] = pulls[t] + extra[section_of[t]] * slack_free[t] / n_per_m[t];
  }

  // By how much the limits of travel, tension and bends are exceeded [m], as `PullLimits.excess`; infinite where
  // that is not a number.
  void excess(const double* pulls, const double* lower, const double* upper, double* out) const {
    double bends[2 * kMostTendons];
    for (int i = 0; i < 2 * sections; ++i) bends[i] = dot(&bends_by_pulls[i * tendons], pulls, tendons);
    for (int t = 0; t < tendons; ++t) {
      const double n = tension(pulls, bends, t);
      out[t] = lower[t] - pulls[t];
      out[tendons + t] = pulls[t] - upper[t];
      out[2 * tendons + t] = (floor_n - n) / n_per_m[t];
      out[3 * tendons + t] = (n - limit_n) / n_per_m[t];
    }
    for (int s = 0; s < sections; ++s) {
      const double x = dot(&variables_by_pulls[2 * s * tendons], pulls, tendons);
      const double y = dot(&variables_by_pulls[(2 * s + 1) * tendons], pulls, tendons);
      out[4 * tendons + s] = std::hypot(x, y) - bend_max_m[s];
    }
    for (int k = 0; k < limits(); ++k)
      if (!std::isfinite(out[k])) out[k] = std::numeric_limits<double>::infinity();
  }

 private:
  double tension(const double* pulls, const double* bends, int t) const {
    const int width = 2 * sections;
    return rest_n[t] + n_per_m[t] * (pulls[t] - dot(&pull_matrix[t * width], bends, width));
  }

  void pulls_of(const double* bends, const double* tight, double* out) const {
    const int width = 2 * sections;
    double lacks[kMostTendons];
    std::fill_n(lacks, sections, -std::numeric_limits<double>::infinity());
    for (int t = 0; t < tendons; ++t) {
      out[t] = dot(&demand[t * width], bends, width);
      double& most = lacks[section_of[t]];
      most = std::max(most, (floor_n - out[t]) / slack_free[t]);
    }
    for (int t = 0; t < tendons; ++t) {
      const int s = section_of[t];
      const double stretch = (out[t] + (lacks[s] + tight[s]) * slack_free[t] - rest_n[t]) / n_per_m[t];
      out[t] = dot(&pull_matrix[t * width], bends, width) + stretch;
    }
  }
};

}  // namespace contid
