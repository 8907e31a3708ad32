// One pneumatic section: its constants, and what pressures make of them. contid/kinematics/cosserat/section.py has the
// equations. Units: mm, N, N*mm, bar.
#pragma once

#include "spatial.hpp"

namespace contid {

// Constants of one section; see section.py.
struct Section {
  double length, link, area, inertia, torsion, shear_ratio, pair_force, modulus[5], modulus_up_to;
  double pair_moment[2][3];                           // about x and y, one column a pair
  Vec weight, link_weight;                            // per length
  Vec end_force = {0, 0, 0}, end_moment = {0, 0, 0};  // dead, at the end of the section before its link
};

// A section at given pressures; see section.Inflated.
struct Inflated {
  double bend, twist, shear, axial, strain, curvature_x, curvature_y, strain_per_bar, softening;
  double per_bar_x[3], per_bar_y[3];
};

inline double modulus(const Section& s, double average, double& slope) {
  const double x = std::fmin(std::fmax(average, 0.0), s.modulus_up_to);
  const double* b = s.modulus;
  const bool inside = average >= 0.0 && average < s.modulus_up_to;
  slope = inside ? 1e-6 * (((4.0 * b[0] * x + 3.0 * b[1]) * x + 2.0 * b[2]) * x + b[3]) : 0.0;
  return 1e-6 * ((((b[0] * x + b[1]) * x + b[2]) * x + b[3]) * x + b[4]);
}

inline Inflated inflate(const Section& s, const double* p) {
  const double sum = p[0] + p[1] + p[2];
  double slope;
  const double e = modulus(s, sum / 3.0, slope);
  Inflated f;
  f.bend = 1.0 / (e * s.inertia);
  f.axial = 1.0 / (e * s.area);
  f.twist = s.shear_ratio / (e * s.torsion);
  f.shear = s.shear_ratio * f.axial;
  f.strain_per_bar = s.pair_force * f.axial;
  f.strain = f.strain_per_bar * sum;
  f.softening = -slope / (3.0 * e);
  f.curvature_x = f.curvature_y = 0.0;
  for (int k = 0; k < 3; ++k) {
    f.per_bar_x[k] = f.bend * s.pair_moment[0][k];
    f.per_bar_y[k] = f.bend * s.pair_moment[1][k];
    f.curvature_x += f.per_bar_x[k] * p[k];
    f.curvature_y += f.per_bar_y[k] * p[k];
  }
  return f;
}

}  // namespace contid
