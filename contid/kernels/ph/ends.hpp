// The quintic through two points with given directions there, with a given length or without.
// extras/ropes/contid_ropes/ph/ends.py derives it.
#pragma once

#include <limits>

#include "quintic.hpp"

namespace contid::ph {

constexpr double straight = 1e-10;  // as long as the chord: every m gives that length
constexpr double energy_ratio = 2.0;
constexpr double energy_allowance = 1.0;

struct Fit {
  Preimage preimage;
  double end_speed;
  double length;
  bool length_met;
};

// End speed m of a length S: (|G|^2 - K^2) m^2 + 240 (dp . G + S K) m + 14400 (|dp|^2 - S^2) = 0 with
// K = 30 - 10 k and 120 S >= m K; NaN when no curve of this branch has the length.
inline double speed_for_length(const Vec& chord, const Vec& G, double k, double length) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const double K = 30.0 - 10.0 * k, chord2 = dot(chord, chord);
  const double surplus = (length - std::sqrt(chord2)) / length;
  if (surplus < -straight) return nan;
  if (1.0 - k < straight && surplus < straight) return length;
  const double c2 = dot(G, G) - K * K;
  const double c1 = 240.0 * (dot(chord, G) + length * K);
  const double c0 = 14400.0 * (chord2 - length * length);
  const double discriminant = c1 * c1 - 4.0 * c2 * c0;
  if (discriminant < 0.0) return nan;
  const double below = c1 + std::sqrt(discriminant);
  const double m = below > 0.0 ? -2.0 * c0 / below : nan;
  return m > 0.0 && 120.0 * length >= m * K * (1.0 - straight) ? m : nan;
}

// End speed m equal to the length it gives: (|G|^2 - (90 + 10 k)^2) m^2 + 240 dp . G m + 14400 |dp|^2 = 0.
inline double speed_as_mean(const Vec& chord, const Vec& G, double k) {
  const double c2 = dot(G, G) - (90.0 + 10.0 * k) * (90.0 + 10.0 * k);
  const double c1 = 240.0 * dot(chord, G), c0 = 14400.0 * dot(chord, chord);
  const double root = std::sqrt(c1 * c1 - 4.0 * c2 * c0);
  return c1 >= 0.0 ? (-c1 - root) / (2.0 * c2) : 2.0 * c0 / (root - c1);
}

// Curve over `chord` between unit tangents; `length` is NaN when it is not known.
inline Fit through(const Vec& chord, const Vec& t0, const Vec& t1, double length, double beta, double gamma) {
  const double cos_beta = std::cos(beta), sin_beta = std::sin(beta);
  const Quat u0 = lift(t0);
  const Quat u2 = turned(nearest(lift(t1), u0, chord), cos_beta, sin_beta);
  const double k = dot(u0, u2);
  const Vec middle = product(u0, u2);
  Vec G;
  for (int i = 0; i < 3; ++i) G[i] = 10.0 * middle[i] - 15.0 * (t0[i] + t1[i]);
  const bool length_given = !std::isnan(length);
  double m = length_given ? speed_for_length(chord, G, k, length) : length;
  Fit fit;
  fit.length_met = !(length_given && std::isnan(m));
  if (std::isnan(m)) m = speed_as_mean(chord, G, k);
  fit.end_speed = m;

  const double root = std::sqrt(m);
  Quat a0, a2, both, apart;
  for (int i = 0; i < 4; ++i) {
    a0[i] = root * u0[i];
    a2[i] = root * u2[i];
    both[i] = a0[i] + a2[i];
    apart[i] = a0[i] - a2[i];
  }
  Vec c;
  for (int i = 0; i < 3; ++i) c[i] = 120.0 * chord[i] + m * G[i];
  const bool open = !(dot(both, both) > no_turn * no_turn * (dot(a0, a0) + dot(a2, a2)));
  const Quat C = turned(nearest(lift(c), open ? apart : both, chord), std::cos(gamma), std::sin(gamma));
  Quat a1;
  for (int i = 0; i < 4; ++i) a1[i] = (C[i] - 3.0 * a0[i] - 3.0 * a2[i]) / 4.0;
  fit.preimage = {a0, a1, a2};
  fit.length = length_of(fit.preimage);
  return fit;
}

// As `through`, for a length with an error of about 1 %: ignored where its energy exceeds `energy_ratio` times
// that of the curve of unknown length plus `energy_allowance` per body length.
inline Fit through_rough(const Vec& chord, const Vec& t0, const Vec& t1, double length) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const Fit fit = through(chord, t0, t1, length, 0.0, 0.0);
  if (std::isnan(length)) return fit;
  Fit free = through(chord, t0, t1, nan, 0.0, 0.0);
  const double most = energy_ratio * energy(free.preimage) + energy_allowance / length;
  if (fit.length_met && energy(fit.preimage) <= most) return fit;
  Fit least = fit;
  double least_energy = std::numeric_limits<double>::infinity();
  for (int branch = 0; branch < 4; ++branch) {
    const Fit other = through(chord, t0, t1, length, branch % 2 ? pi : 0.0, branch / 2 ? pi : 0.0);
    const double cost = energy(other.preimage);
    if (other.length_met && cost < least_energy) {
      least = other;
      least_energy = cost;
    }
  }
  if (least_energy <= most) return least;
  free.length_met = false;
  return free;
}

}  // namespace contid::ph
