// Descent from one command to the next for redundant tasks: the shorter way to what `Homing` settles.
//
// Steps of the same quadratic model, from the last command and without chords in between: each step closes the error
// that the one before left. The answer is the same to kSettled; where steps are long or do not shrink, the general
// solve is needed. Without own weight the base moment of an answer is known beforehand, as in track.hpp: Base = 0
// leaves its columns out.
#pragma once

#include "home.hpp"

namespace contid {

constexpr int kTrackSteps = 8;
constexpr double kTrackShrinks = 0.8;

// Mixes the last two steps so that the change of the step from one to the other would have brought it to zero
// (Anderson 1965, one step of memory): steps shrink by about the same part along the same line.
inline void mix(int n, const double* p, const double* before, const double* last, double* d) {
  double along = 0.0, squared = 0.0;
  for (int j = 0; j < n; ++j) {
    along += d[j] * (d[j] - last[j]);
    squared += (d[j] - last[j]) * (d[j] - last[j]);
  }
  const double part = squared > 0.0 ? along / squared : 0.0;
  for (int j = 0; j < n; ++j) d[j] -= part * (p[j] - before[j] + d[j] - last[j]);
}

// False, with `out` undefined, where the general solve is needed. `most` bounds the first step.
inline bool track_home(int base, const Homing& homing, const double* start, Vec moment, double tolerance, double most,
                       Outcome& out) {
  const int n = homing.n;
  const Limits& limits = homing.limits;
  const bool judges = loaded(homing.rod, homing.force);
  Homing::Point here, there;
  for (int j = 0; j < n; ++j) here.p[j] = std::min(std::max(start[j], limits.lower[j]), limits.upper[j]);
  here.moment = moment;
  double before[kMost] = {}, last[kMost] = {}, plain[kMost], d[kMost], H[kMost][kMost], y[9] = {}, size = 0.0;
  Sweep at(base);
  Reduced by;
  out.at.modes = -1;
  for (int step = 1; step <= kTrackSteps; ++step) {
    sweep(homing.rod, here.p, here.moment, homing.force, 1.0, homing.elements, at);
    if (base == 0)
      by.at_moment(homing.rod, homing.task, at, 0.0);
    else if (!by.eliminate(homing.rod, homing.task, at, 0.0))
      return false;
    here.ends = at.ends();
    here.e = here.ends.moment;
    residual(homing.task, here.ends, here.r);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) H[j][i] = by.H[j][i] + (i == j ? kCentreWeight : 0.0);
    homing.model_step(by, H, here, kTrustStart, y, d);
    const double longer = size;
    size = 0.0;
    for (int j = 0; j < n; ++j) size = std::fmax(size, std::fabs(d[j]));
    out.iterations = step;
    out.met = out.optimal = true;
    if (size <= kSettled) {
      homing.keep(out, here);
      return out.residual <= tolerance && out.statics <= kBalance;
    }
    if (step == 1 ? size > most : !(size < kTrackShrinks * longer)) return false;
    std::copy(d, d + n, plain);
    if (step > 1) mix(n, here.p, before, last, d);
    std::copy(plain, plain + n, last);
    // Its successor would be shorter than what counts as settled.
    if (step > 1 && size * (size / longer) <= kSettled) {
      if (!homing.onto(by, here, d, there, judges ? &out.at : nullptr)) return false;
      const int modes = out.at.modes;
      homing.keep(out, there);
      out.at.modes = modes;
      return true;
    }
    std::copy(here.p, here.p + n, before);
    here.moment = here.moment - by.moment_step(d, 1.0, by.inverse_A * here.e);
    for (int j = 0; j < n; ++j) here.p[j] = std::min(std::max(here.p[j] + d[j], limits.lower[j]), limits.upper[j]);
  }
  return false;
}

}  // namespace contid
