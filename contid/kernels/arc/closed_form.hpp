// Closed forms: the arc to a point, the biarc to a pose, two arcs through two points.
//
// The tip pose of a torsion-free two-section arm has five degrees of freedom, its lengths have six. The free parameter
// of the biarc is the control leg of the first section, a = (L1/theta1) tan(theta1/2). With the tip p, its unit tangent
// t, and a rigid piece h between the sections:
//
//     b  = (p.p - 2 a p_z - h^2 - 2 h a) / (2 (p.t + a (1 - t_z) + h))      control leg of section 2
//     tm = (p - b t - a e_z) / (a + b + h)                                  tangent at the joint
//     theta1 = angle(e_z, tm), L1 = a theta1/tan(theta1/2), the same for section 2 in the frame of the joint
//
// Negative legs are sections bent by more than half a turn.
#pragma once

#include "arc.hpp"

namespace contid {

constexpr double kPi = 3.14159265358979323846;

// The arc (u, v, L) from the origin along +z that ends, after a rigid piece h, at p; false if there is none.
inline bool through(const double* p, double h, double* uvl) {
  const double x = p[0], y = p[1], z = p[2];
  const double r = std::hypot(x, y), chord = std::hypot(r, z + h);
  const double d = r * r + z * z - h * h;
  if (d > 0.0 && chord > 0.0) {
    const double half = std::atan2(r, z + h);
    double bend;
    if (r > 1e-9 * chord) {
      bend = 2.0 * half / r;
    } else if (z + h > 0.0) {
      bend = 2.0 / (z + h);
    } else {
      return false;
    }
    uvl[0] = bend * x;
    uvl[1] = bend * y;
    uvl[2] = d / chord * (half > 1e-9 ? half / std::sin(half) : 1.0);
    return true;
  }
  if (d < 0.0 && r > 0.0) {
    const double theta = 2.0 * std::atan2(r, z + h) - 2.0 * kPi;
    uvl[0] = theta * x / r;
    uvl[1] = theta * y / r;
    uvl[2] = theta * d / (2.0 * r);
    return true;
  }
  return false;
}

// The arc that ends along the unit vector t with the control leg a; negative legs bend past half a turn.
inline bool arc_of_leg(const double* t, double leg, double* uvl) {
  const double across = std::hypot(t[0], t[1]);
  double theta = std::atan2(across, t[2]);
  if (leg < 0.0) theta -= 2.0 * kPi;
  if (across < 1e-12) {
    if (!(leg > 0.0 && t[2] > 0.0)) return false;
    uvl[0] = uvl[1] = 0.0;
    uvl[2] = 2.0 * leg;
    return true;
  }
  uvl[0] = theta * t[0] / across;
  uvl[1] = theta * t[1] / across;
  uvl[2] = std::fabs(theta) > 1e-9 ? leg * theta / std::tan(0.5 * theta) : 2.0 * leg;
  return true;
}

inline void arc_rotation(const double* uvl, double* r) {
  double p[3];
  arc_pose(uvl, coefficients(uvl[0] * uvl[0] + uvl[1] * uvl[1]), p, r);
}

// Both arcs (six numbers) whose tip is `tip` along `t`, for one control leg of the first.
inline bool biarc(const double* tip, const double* t, double leg, const double* rigid, double* arcs) {
  const double between = rigid[0], after = rigid[1];
  double p[3], joint[3], r[9], local[3];
  for (int k = 0; k < 3; ++k) p[k] = tip[k] - after * t[k];
  const double pt = p[0] * t[0] + p[1] * t[1] + p[2] * t[2];
  const double pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
  const double below = 2.0 * (pt + leg * (1.0 - t[2]) + between);
  if (below == 0.0) return false;
  const double leg2 = (pp - 2.0 * leg * p[2] - between * between - 2.0 * between * leg) / below;
  const double whole = leg + leg2 + between;
  if (whole == 0.0) return false;
  for (int k = 0; k < 3; ++k) joint[k] = (p[k] - leg2 * t[k]) / whole;
  joint[2] -= leg / whole;
  if (!arc_of_leg(joint, leg, arcs)) return false;
  arc_rotation(arcs, r);
  turn_back(r, t, local);
  return arc_of_leg(local, leg2, arcs + 3);
}

// Both arcs that end, each after its rigid piece, at `mid` and at `tip`.
inline bool two_arcs(const double* mid, const double* tip, const double* rigid, double* arcs) {
  double r[9], rest[3], local[3];
  if (!through(mid, rigid[0], arcs)) return false;
  arc_rotation(arcs, r);
  for (int k = 0; k < 3; ++k) rest[k] = tip[k] - mid[k];
  turn_back(r, rest, local);
  return through(local, rigid[1], arcs + 3);
}

}  // namespace contid
