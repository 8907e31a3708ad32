// A tendon from a motor over a capstan to a body, written apart from firmware/: springs in N and mm, a cell at the
// motor's end.
#ifndef CONTID_TESTS_CABLE_H
#define CONTID_TESTS_CABLE_H

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "../shafts/shaft.h"

namespace tendons {

const double COUNTS_PER_MM = 4776.0 / 78.53981633974483;

// A minimum jerk way.
struct Way {
  double from = 0.0, to = 0.0, start_s = 0.0, lasts_s = 1.0;

  double part(double t) const { return std::min(1.0, std::max(0.0, (t - start_s) / lasts_s)); }
  double at(double t) const {
    const double p = part(t);
    return from + (to - from) * p * p * p * (10.0 + p * (6.0 * p - 15.0));
  }
  double speed(double t) const {
    const double p = part(t);
    return (to - from) / lasts_s * 30.0 * p * p * (1.0 - p) * (1.0 - p);
  }
};

struct Cable {
  shafts::Shaft shaft;
  double near = 2.0, far = 2.0;  // stiffness on both sides of the capstan [N/mm]
  double friction = 0.3;         // of the capstan: coefficient times angle
  double body = 0.3;             // stiffness of the body [N/mm]
  double damping = 0.02;         // of the body [N s/mm]
  double stall_n = 60.0;         // pull of the stalled motor
  double noise_n = 0.01;
  double base_n = 4.0;  // tension with the shaft and the body at their zero
  bool cut = false;

  Way rest;  // where the body would be without the tendon, towards the motor [mm]
  double slid = 0.0, place = 0.0, tension = 0.0, t = 0.0;

  // The shaft tightens in the sense of `pull`.
  double wound(int pull) const { return pull * shaft.angle / COUNTS_PER_MM; }

  // One millisecond under a duty.
  void run(double duty, int pull) {
    shaft.load = pull * tension / stall_n;
    shaft.run(duty);
    const int parts = 10;
    for (int i = 0; i < parts; ++i) step(wound(pull) + base_n / 2.0, 0.001 / parts);
    t += 0.001;
  }

 private:
  void step(double wound_mm, double dt) {
    const double grip = std::exp(friction);
    const auto pulled = [](double n) { return n > 0.0 ? n : 0.0; };
    double t1 = pulled(near * (wound_mm - slid)), t2 = pulled(far * (slid - place));
    if (t1 > t2 * grip || t1 * grip < t2) {
      // It slides until friction holds the difference.
      const double e = t1 > t2 ? grip : 1.0 / grip;
      slid = (near * wound_mm + e * far * place) / (near + e * far);
      t1 = pulled(near * (wound_mm - slid));
      t2 = pulled(far * (slid - place));
    }
    if (cut) {
      t1 = 0.0;
      t2 = 0.0;
      slid = wound_mm;
    }
    tension = t1;
    place += (t2 - body * (place - rest.at(t) + base_n / body / 2.0)) / damping * dt;
  }
};

inline Cable drawn(std::mt19937& random, double near) {
  const auto between = [&](double low, double high) { return std::uniform_real_distribution<>(low, high)(random); };
  Cable c;
  c.shaft = shafts::within_rating(random, true, 2.0);
  c.shaft.friction = between(0.02, 0.10);
  c.shaft.stiction = c.shaft.friction * between(1.0, 1.2);
  c.shaft.tau = between(0.025, 0.06);
  c.shaft.swing = 0.0;
  c.near = near;
  c.far = between(0.7, 2.5);
  c.friction = between(0.0, 0.8);
  c.body = between(0.1, 1.0);
  c.damping = between(0.005, 0.02);
  c.noise_n = between(0.003, 0.015);
  return c;
}

}  // namespace tendons

#endif
