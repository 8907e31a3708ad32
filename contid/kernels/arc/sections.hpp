// Chains of constant-curvature sections: frames and Jacobians without singularities, no allocation.
//
//     p = p1 + R1 (h1 e_z + p2 + R2 (...)),    J_i = R (Jp_i + Jw_i x rest_i) d(u, v, L)/dl
//
// R is the frame where section i starts and rest_i leads from its end to the tip.
//
// Compiled once per kind of section. Tubes and racks have three lengths per section. With CONTID_TENDON the backbone
// of a section keeps its length, and its two variables are the bends times that length [m]
// (contid/kinematics/tendon/geometry.py).
#pragma once

#include "arc.hpp"
#include "solver.hpp"

namespace contid::section_build {

// A build for one number of sections (CONTID_SECTIONS) has constant loop ends: the same results in half the time.
#ifdef CONTID_SECTIONS
constexpr int kMaxSections = CONTID_SECTIONS;
struct SectionCount {
  static constexpr int count = CONTID_SECTIONS;
  void set_count(int) {}
};
#else
constexpr int kMaxSections = kMostSections;
struct SectionCount {
  int count = 0;
  void set_count(int given) { count = given; }
};
#endif
#ifdef CONTID_TENDON
constexpr int kColumns = 2;  // variables of a section
#else
constexpr int kColumns = 3;
#endif
constexpr int kMaxLengths = kColumns * kMaxSections;

struct Sections : SectionCount {
  double radius[kMaxSections];
  double rigid[kMaxSections];
  double to_arc[kMaxSections][3 * kColumns];      // (l1, l2, l3) -> (u, v, L), row-major
  double to_lengths[kMaxSections][3 * kColumns];  // its inverse
#ifdef CONTID_TENDON
  double backbone[kMaxSections];  // L, which does not change
  double offset[2];               // of the tip, across the last tangent
#endif

  int size() const { return kColumns * count; }

  void arc(const double* lengths, int s, double* uvl) const {
    const double* m = to_arc[s];
    const double* l = lengths + kColumns * s;
#ifdef CONTID_TENDON
    for (int i = 0; i < 2; ++i) uvl[i] = m[2 * i] * l[0] + m[2 * i + 1] * l[1];
    uvl[2] = backbone[s];
#else
    for (int i = 0; i < 3; ++i) uvl[i] = m[3 * i] * l[0] + m[3 * i + 1] * l[1] + m[3 * i + 2] * l[2];
#endif
  }

  void lengths(int s, const double* uvl, double* out) const {
    const double* m = to_lengths[s];
    for (int i = 0; i < kColumns; ++i)
      out[kColumns * s + i] = m[3 * i] * uvl[0] + m[3 * i + 1] * uvl[1] + m[3 * i + 2] * uvl[2];
  }
};

// Derivatives by the lengths, a column for each; size() of them in use.
struct Derivatives {
  Frames frames;
  Column tip[kMaxLengths], spin[kMaxLengths], mid[kMaxLengths];
};

inline void forward(const Sections& s, const double* lengths, Frames& out) {
  static constexpr double kIdentity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  double position[3] = {0, 0, 0}, rotation[9];
  std::memcpy(rotation, kIdentity, sizeof rotation);
  for (int i = 0; i < s.count; ++i) {
    double uvl[3], p[3], r[9], next[9], moved[3];
    s.arc(lengths, i, uvl);
    arc_pose(uvl, coefficients(uvl[0] * uvl[0] + uvl[1] * uvl[1]), p, r);
    for (int k = 0; k < 3; ++k) p[k] += s.rigid[i] * r[3 * k + 2];
    turn(rotation, p, moved);
    product(rotation, r, next);
    std::memcpy(rotation, next, sizeof rotation);
    for (int k = 0; k < 3; ++k) position[k] += moved[k];
    if (i == 0) std::memcpy(out.mid, position, sizeof position);
  }
#ifdef CONTID_TENDON
  for (int k = 0; k < 3; ++k) position[k] += rotation[3 * k] * s.offset[0] + rotation[3 * k + 1] * s.offset[1];
#endif
  std::memcpy(out.tip, position, sizeof position);
  std::memcpy(out.rotation, rotation, sizeof rotation);
}

// J_i = R (Jp_i + Jw_i x rest_i) d(u, v, L)/dl.
inline void differentiate(const Sections& s, const double* lengths, Derivatives& out, bool want_mid) {
  Column position{}, ends[kMaxSections], mid{};
  Column rotation[3] = {{1.0, 0.0, 0.0, 0.0}, {0.0, 1.0, 0.0, 0.0}, {0.0, 0.0, 1.0, 0.0}};
  bool straight = true;  // nothing has turned yet
  const auto turned = [&](double x, double y, double z, Column& to) {
    if (straight)
      to = Column{x, y, z, 0.0};
    else
      to = rotation[0] * x + rotation[1] * y + rotation[2] * z;
  };
  for (int i = 0; i < s.count; ++i) {
    double uvl[3], p[3], r[9];
    s.arc(lengths, i, uvl);
    const double u = uvl[0], v = uvl[1], L = uvl[2];
    const Coefficients c = coefficients(u * u + v * v);
    arc_pose(uvl, c, p, r);
    const double uv = L * u * v * c.B1;
    Column linear[3], angular[2];  // by (u, v, L); the third of the angular ones is zero
    turned(L * (c.B + u * u * c.B1), uv, L * u * c.A1, linear[0]);
    turned(uv, L * (c.B + v * v * c.B1), L * v * c.A1, linear[1]);
    turned(u * c.B, v * c.B, c.A, linear[2]);
    turned(-c.C * u * v, 1.0 - c.C * v * v, -c.B * v, angular[0]);
    turned(c.C * u * u - 1.0, c.C * u * v, c.B * u, angular[1]);
    const double* w = s.to_arc[i];
    for (int j = 0; j < kColumns; ++j) {
      out.tip[kColumns * i + j] = linear[0] * w[j] + linear[1] * w[kColumns + j] + linear[2] * w[2 * kColumns + j];
      out.spin[kColumns * i + j] = angular[0] * w[j] + angular[1] * w[kColumns + j];
    }
    Column moved, next[3];
    turned(p[0], p[1], p[2], moved);
    for (int k = 0; k < 3; ++k) turned(r[k], r[3 + k], r[6 + k], next[k]);
    for (int k = 0; k < 3; ++k) rotation[k] = next[k];
    straight = false;
    ends[i] = position + moved;
    position = ends[i] + s.rigid[i] * rotation[2];
    if (i == 0) mid = position;
  }
#ifdef CONTID_TENDON
  position += rotation[0] * s.offset[0] + rotation[1] * s.offset[1];
#endif
  for (int k = 0; k < 3; ++k) {
    out.frames.tip[k] = position[k];
    out.frames.mid[k] = mid[k];
    for (int j = 0; j < 3; ++j) out.frames.rotation[3 * k + j] = rotation[j][k];
  }
  if (want_mid) {
    Column arm1, arm2, spin1, spin2;
    rotate(mid - ends[0], arm1, arm2);
    for (int j = 0; j < s.size(); ++j) {
      rotate(out.spin[j], spin1, spin2);
      out.mid[j] = j < kColumns ? out.tip[j] + spin1 * arm2 - spin2 * arm1 : Column{};
    }
  }
  for (int i = 0; i < s.count; ++i)
    for (int j = kColumns * i; j < kColumns * (i + 1); ++j) {
      Column carried;
      cross(out.spin[j], position - ends[i], carried);
      out.tip[j] += carried;
    }
}

}  // namespace contid::section_build
