// Chains of constant-curvature sections: frames and Jacobians without singularities, no allocation.
// Twin and specification: contid/kinematics/arc/arc.py, contid/kinematics/arc/sections.py (same names, same formulas).
#pragma once

#include <cmath>
#include <cstring>

#include "../series.hpp"

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
constexpr int kMaxLengths = 3 * kMaxSections;

struct Sections : SectionCount {
  double radius[kMaxSections];
  double rigid[kMaxSections];
  double to_arc[kMaxSections][9];      // (l1, l2, l3) -> (u, v, L), row-major
  double to_lengths[kMaxSections][9];  // its inverse

  int size() const { return 3 * count; }

  void arc(const double* lengths, int s, double* uvl) const {
    const double* m = to_arc[s];
    const double* l = lengths + 3 * s;
    for (int i = 0; i < 3; ++i) uvl[i] = m[3 * i] * l[0] + m[3 * i + 1] * l[1] + m[3 * i + 2] * l[2];
  }

  void lengths(int s, const double* uvl, double* out) const {
    const double* m = to_lengths[s];
    for (int i = 0; i < 3; ++i) out[3 * s + i] = m[3 * i] * uvl[0] + m[3 * i + 1] * uvl[1] + m[3 * i + 2] * uvl[2];
  }
};

// A = sin(t)/t, B = (1 - cos t)/t^2, C = (1 - A)/t^2, A1 = 2 dA/dq, B1 = 2 dB/dq, with q = t^2.
struct Coefficients {
  double A, B, C, A1, B1;
};

inline Coefficients coefficients(double q) {
  Coefficients c;
  if (q < 0.5) {
    // Relative error 1e-14 at the switch.
    static constexpr Series kA(1), kB(2), kC(3), kD(4);
    double a = 0.0, b = 0.0, d = 0.0, a1 = 0.0, b1 = 0.0;
    for (int k = 9; k >= 0; --k) {
      a = a * q + kA.term[k];
      b = b * q + kB.term[k];
      d = d * q + kC.term[k];
      a1 = a1 * q - 2.0 * (k + 1) * kC.term[k];
      b1 = b1 * q - 2.0 * (k + 1) * kD.term[k];
    }
    c = {a, b, d, a1, b1};
  } else {
    const double t = std::sqrt(q);
    const double half = std::sin(0.5 * t);
    c.A = std::sin(t) / t;
    c.B = 2.0 * half * half / q;
    c.C = (1.0 - c.A) / q;
    c.A1 = (std::cos(t) - c.A) / q;
    c.B1 = (c.A - 2.0 * c.B) / q;
  }
  return c;
}

inline void arc_pose(const double* uvl, const Coefficients& c, double* p, double* r) {
  const double u = uvl[0], v = uvl[1], L = uvl[2];
  p[0] = L * u * c.B;
  p[1] = L * v * c.B;
  p[2] = L * c.A;
  r[0] = 1.0 - u * u * c.B;
  r[1] = r[3] = -u * v * c.B;
  r[4] = 1.0 - v * v * c.B;
  r[2] = u * c.A;
  r[5] = v * c.A;
  r[6] = -u * c.A;
  r[7] = -v * c.A;
  r[8] = 1.0 - (u * u + v * v) * c.B;
}

inline void product(const double* a, const double* b, double* out) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

inline void turn(const double* r, const double* x, double* out) {
  for (int i = 0; i < 3; ++i) out[i] = r[3 * i] * x[0] + r[3 * i + 1] * x[1] + r[3 * i + 2] * x[2];
}

inline void turn_back(const double* r, const double* x, double* out) {
  for (int i = 0; i < 3; ++i) out[i] = r[i] * x[0] + r[3 + i] * x[1] + r[6 + i] * x[2];
}

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
    double linear[9], world[9], angular[6];
    product(rotation, jp, linear);
    product(linear, s.to_arc[i], world);
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 2; ++b)
        angular[2 * a + b] =
            rotation[3 * a] * jw[b] + rotation[3 * a + 1] * jw[2 + b] + rotation[3 * a + 2] * jw[4 + b];
    const double* w = s.to_arc[i];
    for (int a = 0; a < 3; ++a)
      for (int j = 0; j < 3; ++j) {
        out.tip[a][3 * i + j] = world[3 * a + j];
        out.spin[a][3 * i + j] = angular[2 * a] * w[j] + angular[2 * a + 1] * w[3 + j];
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
  std::memcpy(out.frames.tip, position, sizeof position);
  std::memcpy(out.frames.rotation, rotation, sizeof rotation);
  if (want_mid) {
    double rest[3];
    for (int k = 0; k < 3; ++k) rest[k] = out.frames.mid[k] - ends[0][k];
    for (int j = 0; j < s.size(); ++j) {
      const bool first = j < 3;
      out.mid[0][j] = first ? out.tip[0][j] + out.spin[1][j] * rest[2] - out.spin[2][j] * rest[1] : 0.0;
      out.mid[1][j] = first ? out.tip[1][j] + out.spin[2][j] * rest[0] - out.spin[0][j] * rest[2] : 0.0;
      out.mid[2][j] = first ? out.tip[2][j] + out.spin[0][j] * rest[1] - out.spin[1][j] * rest[0] : 0.0;
    }
  }
  for (int i = 0; i < s.count; ++i) {
    double rest[3];
    for (int k = 0; k < 3; ++k) rest[k] = position[k] - ends[i][k];
    for (int j = 3 * i; j < 3 * i + 3; ++j) {
      out.tip[0][j] += out.spin[1][j] * rest[2] - out.spin[2][j] * rest[1];
      out.tip[1][j] += out.spin[2][j] * rest[0] - out.spin[0][j] * rest[2];
      out.tip[2][j] += out.spin[0][j] * rest[1] - out.spin[1][j] * rest[0];
    }
  }
}

}  // namespace contid
