// A geared motor with a two-track encoder, written apart from firmware/host: levels of the tracks, not counts.
#ifndef CONTID_TESTS_SHAFT_H
#define CONTID_TESTS_SHAFT_H

#include <cmath>
#include <cstdint>
#include <random>

namespace shafts {

enum class Fault { NONE, DEAD, TRACK_A, TRACK_B, REVERSED };

// One edge per substep at most: 20 substeps per millisecond.
const int SUBSTEPS = 20;

struct Shaft {
  double no_load = 7630.0;          // counts/s at full duty
  double tau = 0.04;                // s
  double friction = 0.05;           // while it turns, of the full duty
  double stiction = 0.05;           // at rest
  double load = 0.0;                // torque against the positive sense, of the full duty
  double swing = 0.0;               // its part that swings with the angle
  double backlash = 0.0;            // counts between motor and output
  bool at_output = false;           // where the encoder sits
  double supply = 1.0;              // of the rated voltage
  double dip = 0.0;                 // greatest sag of the supply under full current
  double low = -1e12, high = 1e12;  // end stops of the motor, counts
  bool blocked = false;

  // Speed that it surely keeps, in counts/s.
  double capable() const { return no_load * (supply - dip - friction - std::fabs(load) - std::fabs(swing)); }

  double angle = 0.3, speed = 0.0, output = 0.3;
  Fault fault = Fault::NONE;
  int count = 0, levels = 0;

  // Runs for one millisecond under `duty` (-1 .. 1); without drive the terminals are shorted.
  void run(double duty) {
    for (int i = 0; i < SUBSTEPS; ++i) {
      turn(duty, 0.001 / SUBSTEPS);
      read();
    }
  }

  // Breaks the encoder; what is open keeps its level.
  void fail(Fault kind) { fault = kind; }

 private:
  void turn(double duty, double dt) {
    const double amps = std::fabs(duty - speed / no_load);
    const double volts = supply - dip * (amps > 1.0 ? 1.0 : amps);
    const double torque = duty * volts - speed / no_load - load - swing * std::sin(angle / 700.0);
    if (blocked) {
      speed = 0.0;
      return;
    }
    if (speed == 0.0 && std::fabs(torque) <= stiction) return;
    const double sense = speed != 0.0 ? speed : torque;
    const double next = speed + (torque - std::copysign(friction, sense)) * no_load * dt / tau;
    speed = speed * next < 0.0 ? 0.0 : next;
    angle += speed * dt;
    if (angle < low || angle > high) {
      angle = angle < low ? low : high;
      speed = 0.0;
    }
    if (output < angle - backlash / 2) output = angle - backlash / 2;
    if (output > angle + backlash / 2) output = angle + backlash / 2;
  }

  void read() {
    const int place = static_cast<int>(std::floor(at_output ? output : angle)) & 3;
    int a = place >> 1, b = (place >> 1) ^ (place & 1);
    if (fault == Fault::DEAD || fault == Fault::TRACK_A) a = levels >> 1;
    if (fault == Fault::DEAD || fault == Fault::TRACK_B) b = levels & 1;
    if (fault == Fault::REVERSED) {
      const int both = a;
      a = b;
      b = both;
    }
    const int now = a << 1 | b;
    static const int STEP[16] = {0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0};
    count += STEP[levels << 2 | now];
    levels = now;
  }
};

// A shaft within rating: friction 2 to 30 %, time constant 10 to 160 ms, speed and supply each within 20 %.
// `holds`: friction holds the load, as in gears of high ratio. `play` before the encoder, at most, in counts.
inline Shaft within_rating(std::mt19937& random, bool holds, double play) {
  const auto between = [&](double low, double high) { return std::uniform_real_distribution<>(low, high)(random); };
  Shaft s;
  s.no_load *= between(0.8, 1.2);
  s.tau = 0.01 * std::pow(16.0, between(0.0, 1.0));
  s.friction = between(0.02, 0.30);
  s.stiction = std::fmin(0.33, s.friction * between(1.0, 1.3));
  // Friction and load together need less than the file's stall_percent.
  const double spare = holds ? std::fmin(0.38 - s.stiction, s.friction) : 0.38 - s.stiction;
  s.load = between(-0.6, 0.6) * spare;
  s.swing = between(0.0, 0.4) * spare;
  s.supply = between(0.9, 1.05);
  s.dip = between(0.0, 0.1);
  s.at_output = between(0.0, 1.0) < 0.5;
  s.backlash = between(0.0, 1.0) < 0.3 ? 0.0 : between(0.0, s.at_output ? play : 30.0);
  return s;
}

}  // namespace shafts

#endif
