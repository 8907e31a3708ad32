// The branch of equilibria on which the arm stands.
//
// A loaded rod has several equilibria, some of them stable. The one that counts is reached when pressures and loads
// grow together from zero, without a jump; where it loses its stability on the way, the arm snaps through to an
// equilibrium that statics does not determine. Forward and inverse share this definition.
//
//     e(M(s), s P, s F) = 0,   s from 0 to 1
//
// is followed by prediction (a parabola in s through the last points) and correction by Newton's method (Allgower and
// Georg, Numerical Continuation Methods, 1990). A path stays on its branch because each point must be stable, lie in
// the neighbourhood of its prediction in which Newton's method contracts, and have about the stiffness predicted;
// otherwise the step is halved. It ends at s = 1, or short of it where the step falls below 0.005 %: there the branch
// ends.
#pragma once

#include <limits>

#include "balance.hpp"

namespace contid {

constexpr int kCorrections = 8, kMaxElements = 48;
// A correction that does not shrink the balance to this part has started outside the neighbourhood of its solution:
// this is what keeps a path on its branch.
constexpr double kContraction = 0.3;
// How far the stiffness may be from its prediction, as a part of the smaller one at both ends of a step: a path that
// passes near a fork changes it abruptly, and a longer step could end on the other side. Steps of less than this part
// are short enough; towards a critical load the stiffness of some rods is a square.
constexpr double kPredicted = 2.0, kShortStep = 4e-3;
// How far a base moment may be from its prediction, as a part of the larger one at both ends of a step: farther away
// Newton's method has found another equilibrium.
constexpr double kCorrected = 0.2;
constexpr double kFirstStep = 0.25, kLeastStep = 5e-5, kTinyStep = 1e-6, kOnTheWay = 1e-5, kRough = 1e-2, kNear = 0.02,
                 kSameFactor = 5e-3, kSamePose = 1e-4;
constexpr double kLeastScale = 1e-4;  // of loads [N*mm]: parts of less than this are rounding

// Moment of all loads at full length [N*mm].
inline double load_moment(const Rod& rod, Vec tip_force) {
  double force = norm(tip_force);
  double moment = norm(rod.tip_moment);
  for (const Section& s : rod.sections) {
    force += norm(own_weight(s)) + norm(s.end_force);
    moment += norm(s.end_moment);
  }
  return force * rod.reach + moment;
}

// What base moments are compared with [N*mm].
inline double load_scale(const Rod& rod, Vec tip_force) { return std::fmax(kLeastScale, load_moment(rod, tip_force)); }

// True when two base moments belong to one equilibrium.
inline bool same_pose(const Rod& rod, Vec tip_force, Vec moment, Vec other) {
  return norm(moment - other) <= kSamePose * load_scale(rod, tip_force);
}

inline double statics_tolerance(double scale) { return std::fmax(kStatics, kRounding * scale); }

// Of a point before the last, by the stiffness of the point before it: where the arm is soft, a small moment moves it
// far, and the next point is predicted from there.
inline double tolerance_on_the_way(double scale, double stiff) {
  return std::fmax(statics_tolerance(scale), kOnTheWay * scale * std::fmin(1.0, std::fabs(stiff)));
}

// Newton's method that ends where a step does not contract the balance. True for a stable equilibrium.
inline bool settle(const Rod& rod, const double* pressures, Vec& moment, Vec tip_force, double share, int elements,
                   double tolerance, Judged& out) {
  double before = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kCorrections; ++i) {
    judge(rod, pressures, moment, tip_force, share, elements, out);
    const double error = norm(out.ends.moment);
    if (error <= tolerance) return rod.moments || out.modes == 0;  // a dead moment has no energy
    if (!(error < kContraction * before) || !out.regular) return false;
    before = error;
    moment = moment - out.moment_by_balance * out.ends.moment;
  }
  return false;
}

// Determinant of the moment balance by the base moment: 1 without load, 0 at a critical load.
inline double stiffness(const Judged& at) { return 1.0 / determinant(at.moment_by_balance); }

// One end of a straight way in pressures, tip force and share of the own weight.
struct Station {
  const double* pressures;
  Vec tip_force;
  double share;
};

struct Unheeded {
  void operator()(double, Vec) const {}
};

// Follows stable equilibria from one station to another. `moment` and `out` are those of the last one reached; returns
// the part of the way done, 1 for all of it, to 0.005 %. `passed` gets the part and the moment of each.
template <class Passed = Unheeded>
double follow(const Rod& rod, const Station& from, const Station& to, int elements, Vec& moment, Judged& out,
              const Passed& passed = {}) {
  const double scale = std::fmax(load_scale(rod, from.tip_force), load_scale(rod, to.tip_force));
  const int n = rod.pressures();
  double done = 0.0, behind = 0.0, step = kFirstStep, p[kMost];
  Vec slope = {0, 0, 0}, bend = {0, 0, 0};
  judge(rod, from.pressures, moment, from.tip_force, from.share, elements, out);
  double stiff = stiffness(out), stiff_before = stiff;
  while (done < 1.0) {
    const double goal = std::fmin(1.0, done + step), share = from.share + goal * (to.share - from.share);
    const Vec rise = goal * (to.tip_force - from.tip_force);
    for (int j = 0; j < n; ++j) p[j] = from.pressures[j] + goal * (to.pressures[j] - from.pressures[j]);
    // A dead tip force has a moment about the base that follows from the tip; afterwards the points before predict.
    const double ahead = done > 0.0 ? (goal - done) / (done - behind) : 0.0;
    const Vec predicted =
        done > 0.0 ? moment + (goal - done) * (slope + (goal - behind) * bend) : moment + cross(out.ends.p, rise);
    Vec corrected = predicted;
    Judged trial;
    const double tolerance = goal < 1.0 ? tolerance_on_the_way(scale, stiff) : statics_tolerance(scale);
    bool near = settle(rod, p, corrected, from.tip_force + rise, share, elements, tolerance, trial);
    double stiff_there = 0.0;
    if (near) {
      stiff_there = stiffness(trial);
      const double away = std::fabs(stiff_there - stiff - ahead * (stiff - stiff_before));
      near =
          goal - done <= kShortStep * goal || away <= kPredicted * std::fmin(std::fabs(stiff), std::fabs(stiff_there));
    }
    if (near && done > 0.0)
      near = norm(corrected - predicted) <= kCorrected * std::fmax(norm(moment), norm(corrected)) + kOnTheWay * scale;
    if (near) {
      // By divided differences: a parabola through the last three points, first a line through two.
      const Vec slope_before = slope;
      slope = (1.0 / (goal - done)) * (corrected - moment);
      if (done > 0.0) bend = (1.0 / (goal - behind)) * (slope - slope_before);
      behind = done, stiff_before = stiff, stiff = stiff_there;
      moment = corrected, done = goal;
      out = trial;
      passed(done, moment);
      step *= 2.0;
    } else {
      step = 0.5 * (goal - done);
      if (step < kLeastStep * goal + kTinyStep) break;
    }
  }
  return done;
}

// True when anything acts on the rod; without load every equilibrium is stable and the strains are constant.
inline bool loaded(const Rod& rod, Vec tip_force) {
  const auto acts = [](Vec load) { return dot(load, load) > 0.0; };
  if (acts(tip_force) || acts(rod.tip_moment)) return true;
  return std::any_of(rod.begin(), rod.end(),
                     [&](const Section& s) { return acts(own_weight(s)) || acts(s.end_force) || acts(s.end_moment); });
}

// The equilibrium that the arm reaches when pressures and loads grow together from zero; returns the part done.
inline double equilibrium(const Rod& rod, const double* pressures, Vec tip_force, int elements, Vec& moment,
                          Judged& out) {
  const double none[kMost] = {};
  moment = {0, 0, 0};
  if (loaded(rod, tip_force))
    return follow(rod, {none, {0, 0, 0}, 0.0}, {pressures, tip_force, 1.0}, elements, moment, out);
  judge(rod, pressures, moment, tip_force, 1.0, elements, out);
  return 1.0;
}

// Base moment of a rod whose tip is at `tip`; weights are put on the chord.
inline Vec predicted_moment(const Rod& rod, Vec tip, Vec tip_force, double share) {
  Vec moment = cross(tip, tip_force);
  double done = 0.0;
  for (int i = 0; i < rod.count; ++i) {
    const Section& s = rod.sections[i];
    const double middle = (done + 0.5 * s.length) / rod.reach, at = (done + s.length + 0.5 * s.link) / rod.reach;
    moment =
        moment + (middle * s.length * share) * cross(tip, s.weight) + (at * s.link * share) * cross(tip, s.link_weight);
    done += s.length + s.link;
  }
  return moment;
}

// True when a stable equilibrium is the one of `equilibrium`. Tried first: a curve from the straight arm to it, held
// against the balance at three points of the way, roughly and therefore with fewer elements.
inline bool on_branch(const Rod& rod, const double* pressures, Vec moment, Vec tip_force, int elements) {
  const double scale = load_scale(rod, tip_force);
  const int few = std::max(2, 2 * elements / 3);
  const Vec slope = predicted_moment(rod, {0, 0, rod.reach}, tip_force, 1.0);
  Vec bend = moment - slope, bent_half = bend;  // of (M - s slope) / s^2 at s = 1 and 1/2
  Judged at;
  double p[kMost];
  bool smooth = true;
  for (double part : {0.5, 0.25, 0.75}) {
    for (int j = 0; j < rod.pressures(); ++j) p[j] = part * pressures[j];
    const Vec bent = bent_half + (2.0 * part - 1.0) * (bend - bent_half);
    Vec guess = part * slope + (part * part) * bent;
    if (part == 0.5) {
      smooth = settle(rod, p, guess, part * tip_force, part, few, kRough * scale, at);
      bent_half = 4.0 * (guess - part * slope);
    } else {
      judge(rod, p, guess, part * tip_force, part, few, at);
      smooth = at.modes == 0 && norm(at.moment_by_balance * at.ends.moment) <= kNear * scale;
    }
    if (!smooth) break;
  }
  if (smooth) return true;
  Vec found;
  return equilibrium(rod, pressures, tip_force, elements, found, at) == 1.0 && same_pose(rod, tip_force, found, moment);
}

// Some equilibrium under the full load, for a rod whose branch ends before; `moment` and `out` are those of its end.
inline void buckled(const Rod& rod, const double* pressures, Vec tip_force, int elements, Vec& moment, Judged& out) {
  Sweep unused;
  if (!rod.joints && !rod.moments) moment = cross(out.ends.p, tip_force);
  newton(rod, pressures, moment, tip_force, 1.0, elements, unused);
  judge(rod, pressures, moment, tip_force, 1.0, elements, out);
}

// Least factor of the tip force at which the arm, inflated and under its own weight, loses its stability; -1 when it is
// stable up to `max_factor`, 0 when the own weight alone buckles it. Elements are doubled until two verdicts agree.
inline double critical_factor(const Rod& rod, const double* pressures, Vec tip_force, double max_factor, int elements) {
  double found = -1.0;
  for (;; elements *= 2) {
    const double before = found;
    Vec moment;
    Judged at;
    found = 0.0;
    if (equilibrium(rod, pressures, {0, 0, 0}, elements, moment, at) == 1.0) {
      const Vec full = max_factor * tip_force;
      found = follow(rod, {pressures, {0, 0, 0}, 1.0}, {pressures, full, 1.0}, elements, moment, at);
      if (found == 1.0) return -1.0;
    }
    if (elements >= kMaxElements || std::fabs(found - before) <= kSameFactor * found) return max_factor * found;
  }
}

}  // namespace contid
