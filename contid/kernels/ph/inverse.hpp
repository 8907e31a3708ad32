// Inverse kinematics by shape: tube lengths from the pose of the tip. No allocation, no exceptions.
//
// Between nearly straight ends every branch of a quintic turns surplus length into a loop. A length known to about 1 %
// is rejected where that costs more than twice the energy of the curve of unknown length and of a turn of one radian.
#pragma once

#include "ends.hpp"
#include "tubes.hpp"

namespace contid::ph {

constexpr int max_sections = 8;
constexpr int max_tubes = 8;

// An arm of sections with tubes around them, standing on its base along +z.
struct Arm {
  int sections = 0, tubes = 0;
  double offset_cos[max_sections][max_tubes];  // d cos(alpha)
  double offset_sin[max_sections][max_tubes];
  double split[max_sections];  // share of each section in the length of the backbone
};

struct Inverse {
  double lengths[max_sections * max_tubes];
  bool length_met;
};

// l_i = S - d (u cos alpha_i + v sin alpha_i) along the curve from the base to the tip.
inline Inverse inverse(const Arm& arm, const Vec& tip, const Vec& direction, double length) {
  Inverse out;
  const double size = std::sqrt(dot(direction, direction));
  const Vec t1 = {direction[0] / size, direction[1] / size, direction[2] / size};
  const Fit fit = through_rough(tip, {0.0, 0.0, 1.0}, t1, length);
  out.length_met = fit.length_met;
  double backbone[max_sections], bending[2 * max_sections], joints[max_sections + 1] = {0.0}, travelled = 0.0;
  for (int section = 0; section < arm.sections; ++section) {
    backbone[section] = fit.length * arm.split[section];
    travelled += backbone[section];
    joints[section + 1] = section + 1 < arm.sections ? parameter_at(fit.preimage, fit.length, travelled) : 1.0;
  }
  section_bending(fit.preimage, joints, arm.sections, bending);
  for (int section = 0; section < arm.sections; ++section) {
    const double u = bending[2 * section], v = bending[2 * section + 1];
    for (int tube = 0; tube < arm.tubes; ++tube)
      out.lengths[section * arm.tubes + tube] =
          backbone[section] - (u * arm.offset_cos[section][tube] + v * arm.offset_sin[section][tube]);
  }
  return out;
}

}  // namespace contid::ph
