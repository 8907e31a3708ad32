// Bending of the sections along a quintic, in a rotation-minimising frame.
//
// A tube runs at the distance d from the backbone, in the direction e = U cos alpha + V sin alpha of a frame (U, V)
// that does not spin about the tangent. Its length per length of the backbone is 1 - d kappa . e exactly, with the
// curvature vector kappa. So between two points of the curve, S apart along the backbone,
//
//     l_i = S - d (u cos alpha_i + v sin alpha_i),  u = int kappa . U ds,  v = int kappa . V ds
//
// as for a constant-curvature section (L, u, v). For a plane curve u and v are turning angles: the lengths depend on S
// and the end directions only.
//
// The rotation-minimising frame is the Euler-Rodrigues frame turned by psi with psi' = -w1; psi at the three Gauss
// points of a panel comes from collocation. 8 panels per section agree with 64 in the 8th decimal of a mm.
#pragma once

#include "quintic.hpp"

namespace contid::ph {

constexpr int panels = 8;  // per section; agree with 64 in the 8th decimal of a mm

// Bending (u, v) of each section between parameters joints[0..sections], in the rotation-minimising frame
// that starts with U = x of the base.
inline void section_bending(const Preimage& A, const double* joints, int sections, double* bending) {
  static const double r15 = std::sqrt(15.0);
  static const double node[3] = {0.5 - r15 / 10.0, 0.5, 0.5 + r15 / 10.0};
  static const double weight[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
  static const double within[3][3] = {{5.0 / 36.0, 2.0 / 9.0 - r15 / 15.0, 5.0 / 36.0 - r15 / 30.0},
                                      {5.0 / 36.0 + r15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - r15 / 24.0},
                                      {5.0 / 36.0 + r15 / 30.0, 2.0 / 9.0 + r15 / 15.0, 5.0 / 36.0}};
  const Quat& a0 = A[0];
  const double u0 = a0[0], v0 = a0[1], p0 = a0[2], q0 = a0[3];
  double psi = std::atan2(2.0 * (u0 * p0 + v0 * q0), 2.0 * (v0 * p0 - u0 * q0));
  for (int section = 0; section < sections; ++section) {
    const double width = (joints[section + 1] - joints[section]) / panels;
    double sum_u = 0.0, sum_v = 0.0;
    for (int panel = 0; panel < panels; ++panel) {
      double spin[3], k2[3], k3[3];
      for (int i = 0; i < 3; ++i) {
        const Spinor s = spinor(A, joints[section] + width * (panel + node[i]));
        const Rates at = rates(s);
        const double per = 2.0 / s.sigma;
        spin[i] = per * at.spin;
        k2[i] = per * at.k2;
        k3[i] = per * at.k3;
      }
      for (int i = 0; i < 3; ++i) {
        const double turn = psi - width * (within[i][0] * spin[0] + within[i][1] * spin[1] + within[i][2] * spin[2]);
        const double cosine = std::cos(turn), sine = std::sin(turn);
        sum_u += weight[i] * (cosine * k2[i] + sine * k3[i]);
        sum_v += weight[i] * (cosine * k3[i] - sine * k2[i]);
      }
      psi -= width * (weight[0] * spin[0] + weight[1] * spin[1] + weight[2] * spin[2]);
    }
    bending[2 * section] = width * sum_u;
    bending[2 * section + 1] = width * sum_v;
  }
}

}  // namespace contid::ph
