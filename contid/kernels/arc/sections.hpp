// Chains of constant-curvature sections: frames and Jacobians without singularities, no allocation.
// Twin and specification: contid/kinematics/arc/sections.py (same names, same formulas).
//
// Compiled once per kind of section. Tubes and racks have three lengths per section. With CONTID_TENDON the backbone
// of a section keeps its length, and its two variables are the bends times that length [m]
// (contid/kinematics/tendon/sections.py).
#pragma once

#include "arc.hpp"

namespace contid {

// A build for one number of sections (CONTID_SECTIONS) has constant loop ends: the same results in half the time.
#ifdef CONTID_SECTIONS
constexpr int kMaxSections = CONTID_SECTIONS;
struct SectionCount {
  static constexpr int count = CONTID_SECTIONS;
};
#else
constexpr int kMaxSections = 8;
struct SectionCount {
  int count = 0;
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

struct Frames {
  double tip[3];
  double rotation[9];
  double mid[3];
};

// Derivatives by the lengths; rows of kMaxLengths columns, size() of them in use.
struct Derivatives {
  Frames frames;
  double tip[3][kMaxLengths];
  double spin[3][kMaxLengths];
  double mid[3][kMaxLengths];
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

// J_i = R (Jp_i + Jw_i x rest_i) d(u, v, L)/dl; see differentiate() in contid/kinematics/arc/sections.py.
inline void differentiate(const Sections& s, const double* lengths, Derivatives& out, bool want_mid) {
  static constexpr double kIdentity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  double position[3] = {0, 0, 0}, rotation[9], ends[kMaxSections][3];
  std::memcpy(rotation, kIdentity, sizeof rotation);
  for (int i = 0; i < s.count; ++i) {
    double uvl[3], p[3], r[9], next[9], moved[3];
    s.arc(lengths, i, uvl);
    const double u = uvl[0], v = uvl[1], L = uvl[2];
    const Coefficients c = coefficients(u * u + v * v);
    arc_pose(uvl, c, p, r);
    const double uu = L * (c.B + u * u * c.B1), uv = L * u * v * c.B1, vv = L * (c.B + v * v * c.B1);
    const double jp[9] = {uu, uv, u * c.B, uv, vv, v * c.B, L * u * c.A1, L * v * c.A1, c.A};
    const double jw[6] = {-c.C * u * v, c.C * u * u - 1.0, 1.0 - c.C * v * v,
                          c.C * u * v,  -c.B * v,          c.B * u};  // its third column is zero
    double linear[9], world[3 * kColumns], angular[6];
    product(rotation, jp, linear);
    const double* w = s.to_arc[i];
    for (int a = 0; a < 3; ++a)
      for (int j = 0; j < kColumns; ++j)
        world[kColumns * a + j] =
            linear[3 * a] * w[j] + linear[3 * a + 1] * w[kColumns + j] + linear[3 * a + 2] * w[2 * kColumns + j];
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 2; ++b)
        angular[2 * a + b] =
            rotation[3 * a] * jw[b] + rotation[3 * a + 1] * jw[2 + b] + rotation[3 * a + 2] * jw[4 + b];
    for (int a = 0; a < 3; ++a)
      for (int j = 0; j < kColumns; ++j) {
        out.tip[a][kColumns * i + j] = world[kColumns * a + j];
        out.spin[a][kColumns * i + j] = angular[2 * a] * w[j] + angular[2 * a + 1] * w[kColumns + j];
      }
    turn(rotation, p, moved);
    product(rotation, r, next);
    std::memcpy(rotation, next, sizeof rotation);
    for (int k = 0; k < 3; ++k) {
      ends[i][k] = position[k] + moved[k];
      position[k] = ends[i][k] + s.rigid[i] * rotation[3 * k + 2];
    }
    if (i == 0) std::memcpy(out.frames.mid, position, sizeof position);
  }
#ifdef CONTID_TENDON
  for (int k = 0; k < 3; ++k) position[k] += rotation[3 * k] * s.offset[0] + rotation[3 * k + 1] * s.offset[1];
#endif
  std::memcpy(out.frames.tip, position, sizeof position);
  std::memcpy(out.frames.rotation, rotation, sizeof rotation);
  if (want_mid) {
    double rest[3];
    for (int k = 0; k < 3; ++k) rest[k] = out.frames.mid[k] - ends[0][k];
    for (int j = 0; j < s.size(); ++j) {
      const bool first = j < kColumns;
      out.mid[0][j] = first ? out.tip[0][j] + out.spin[1][j] * rest[2] - out.spin[2][j] * rest[1] : 0.0;
      out.mid[1][j] = first ? out.tip[1][j] + out.spin[2][j] * rest[0] - out.spin[0][j] * rest[2] : 0.0;
      out.mid[2][j] = first ? out.tip[2][j] + out.spin[0][j] * rest[1] - out.spin[1][j] * rest[0] : 0.0;
    }
  }
  for (int i = 0; i < s.count; ++i) {
    double rest[3];
    for (int k = 0; k < 3; ++k) rest[k] = position[k] - ends[i][k];
    for (int j = kColumns * i; j < kColumns * (i + 1); ++j) {
      out.tip[0][j] += out.spin[1][j] * rest[2] - out.spin[2][j] * rest[1];
      out.tip[1][j] += out.spin[2][j] * rest[0] - out.spin[0][j] * rest[2];
      out.tip[2][j] += out.spin[0][j] * rest[1] - out.spin[1][j] * rest[0];
    }
  }
}

}  // namespace contid
