// Exact inverse kinematics of the unloaded rod: each section is a circular arc, then a straight link.
//
// Without load the strains of a section are constant. The end of an arc that begins along e3 determines it, the arc its
// three pressures. An arc may be drawn as two tangents of one length d, along e3 and along the tangent t at its end:
// it ends at d (e3 + t), and t is the mirror image of e3 at the chord. Two sections with a tip direction form a biarc
// with one free parameter, d of the first section; of `kMembers` members the one nearest to the centre is taken.
#pragma once

#include "solve.hpp"

namespace contid {

// Members of the family of biarcs, and d of the first and the last as a share of the length; 0.5 is straight.
constexpr int kMembers = 9;
constexpr double kLeastTangent = 0.3, kTangentRange = 0.8;

// Mean x of the three pressures that stretches a section to `stretch` times its length: 3 f x / (A E(x)) = stretch - 1
// with f the force of a pair of chambers per bar; beyond the pressures of its modulus E by the modulus at their end.
inline double average_pressure(const Section& s, double stretch) {
  const double push = 3.0 * s.pair_force / s.area, strain = stretch - 1.0, top = s.modulus_up_to;
  double slope;
  if (strain <= 0.0) return strain * modulus(s, 0.0, slope) / push;
  const double at_top = modulus(s, top, slope);
  if (strain >= push * top / at_top) return strain * at_top / push;
  double low = 0.0, high = top, x = 0.5 * top;
  for (int i = 0; i < 60; ++i) {
    const double e = modulus(s, x, slope), error = push * x / e - strain;
    (error > 0.0 ? high : low) = x;
    const double newton = x - error / (push / e * (1.0 - x * slope / e));
    const double following = low < newton && newton < high ? newton : 0.5 * (low + high);
    if (std::fabs(following - x) < 1e-15) break;
    x = following;
  }
  return x;
}

// Pressures of the arc that ends at `end`, and false where there is none: their sum stretches it, their moments bend it
// by the angle theta = 2 half, with M = E I theta / L about the axis (-y, x) / r.
inline bool arc_pressures(const Section& s, Vec end, double* p) {
  const double r = std::hypot(end.x, end.y), half = std::atan2(r, end.z), chord = norm(end);
  const double arc = chord * (half > 1e-8 ? half / std::sin(half) : 1.0);
  const double x = average_pressure(s, arc / s.length);
  double slope;
  const double stiffness = modulus(s, x, slope) * s.inertia;
  const double scale = r > 0.0 ? stiffness * 2.0 * half / s.length / r : 0.0;
  Mat rows{}, inv;
  for (int k = 0; k < 3; ++k)
    rows.m[0][k] = s.pair_moment[0][k], rows.m[1][k] = s.pair_moment[1][k], rows.m[2][k] = 1.0;
  if (!inverse(rows, inv)) return false;
  const Vec q = inv * Vec{-scale * end.y, scale * end.x, 3.0 * x};
  put(p, q);
  return finite(q);
}

// Pressures of an arc and its link that end at `tip`: |tip - d e3| = d + link gives d.
inline bool tip_pressures(const Section& s, Vec tip, double* p) {
  if (s.link == 0.0) return arc_pressures(s, tip, p);
  const double d = (dot(tip, tip) - s.link * s.link) / (2.0 * (tip.z + s.link));
  const Vec e3{0, 0, 1}, tangent = (1.0 / (d + s.link)) * (tip - d * e3);
  return arc_pressures(s, d * (e3 + tangent), p);
}

// Pressures of two sections, the first of which ends at `mid`, before its link; m is its tangent there.
inline bool mid_and_tip_pressures(const Section& first, const Section& second, Vec mid, Vec tip, double* p) {
  const Vec m = (2.0 * mid.z / dot(mid, mid)) * mid - Vec{0, 0, 1};
  const Vec rest = transposed_times(tilt(m), tip - mid - first.link * m);
  return arc_pressures(first, mid, p) && tip_pressures(second, rest, p + 3);
}

// Pressures of the biarc that ends at `tip` along `t`, for the length d1 of the tangents of the first arc. The tangents
// of both form a polygon, d1 e3 + (d1 + link + d2) m + d2 t = end, whose middle part has a known length: that gives d2.
inline bool tip_and_direction_pressures(const Section& first, const Section& second, Vec tip, Vec t, double d1,
                                        double* p) {
  const Vec e3{0, 0, 1}, end = tip - second.link * t;
  const double link = first.link;
  const double d2 =
      (dot(end, end) - link * link - 2.0 * d1 * (end.z + link)) / (2.0 * (dot(end, t) + link) + 2.0 * d1 * (1.0 - t.z));
  const Vec m = (1.0 / (d1 + link + d2)) * (end - d2 * t - d1 * e3);
  return mid_and_tip_pressures(first, second, d1 * (e3 + m), tip, p);
}

// Pressures of the unloaded closed form for one or two sections, clamped; false where there is none for this task.
inline bool unloaded(const Rod& rod, const Task& task, const Limits& limits, double* p) {
  bool found = false;
  if (rod.count == 1) {
    found = tip_pressures(rod.sections[0], task.tip, p);
  } else if (rod.count == 2) {
    const Section &first = rod.sections[0], &second = rod.sections[1];
    if (task.has_mid) {
      found = mid_and_tip_pressures(first, second, task.mid, task.tip, p);
    } else if (task.has_direction) {
      double best = std::numeric_limits<double>::infinity(), member[6];
      for (int i = 0; i < kMembers; ++i) {
        const double d1 = (kLeastTangent + kTangentRange * i / (kMembers - 1)) * first.length;
        if (!tip_and_direction_pressures(first, second, task.tip, task.direction, d1, member)) continue;
        double away = 0.0;
        for (int j = 0; j < 6; ++j) away += (member[j] - limits.centre[j]) * (member[j] - limits.centre[j]);
        if (away < best) {
          best = away;
          std::copy(member, member + 6, p);
          found = true;
        }
      }
    }
  }
  if (found) clamp(limits, p);
  return found;
}

}  // namespace contid
