// Plant of an emulated board: geared motors with encoders, or regulators with soft chambers.
#ifndef CONTID_PLANT_H
#define CONTID_PLANT_H

#include <cmath>
#include <cstdint>
#include <string>

#include "../contid_due/src/core/board.h"

namespace contid {

// First order motor behind a gear that friction can hold:
// tau dv/dt = duty v0 - v - friction v0 sign(v); brake: duty 0; coast: only friction acts.
struct MotorPlant {
  double no_load = 7630.0;          // speed at full duty [counts/s]
  double tau = 0.04;                // [s]
  double friction = 0.05;           // of the full duty
  double low = -1e12, high = 1e12;  // end stops [counts]
  double stall_ma = 1600.0;
  double full_scale_ma = 3300.0;

  double shaft = 0.0;  // [counts], the true position
  double speed = 0.0;
  double current_ma = 0.0;
  double encoder = 0.0;
  double missed = 0.0;                // encoder edges
  uint32_t edges_a = 0, edges_b = 0;  // level changes of the tracks
  double unseen = 0.0;                // motion since a track is open, by which the other one goes on
  bool stalled = false, bridge = false, stuck = false, reversed = false;
  bool open_a = false, open_b = false;  // a track of the encoder that keeps its level
  double encoder_share = 1.0;           // of the motion that the encoder sees: a slipped horn, another pinion
  bool wired_coast = false;             // pulled down: it coasts while its lines are not driven
  // Wires that are exchanged as the robot file states; `reversed` is a fault beside it.
  bool motor_wired = false, encoder_wired = false;

  void step(const Output& out, double dt) {
    const bool coasts = out.drive == Drive::COAST || (out.drive == Drive::OFF && wired_coast);
    const double full = motor_wired ? -DUTY_FULL : DUTY_FULL;
    const double duty = out.drive == Drive::RUN ? static_cast<double>(out.duty) / full : 0.0;
    const double before = shaft;
    const double emf = coasts ? 0.0 : duty * no_load - speed;
    double push = emf;
    const double hold = friction * no_load;
    if (speed == 0.0 && std::fabs(push) <= hold) {
      push = 0.0;
    } else {
      push -= std::copysign(hold, speed == 0.0 ? push : speed);
    }
    const double next = speed + push * dt / tau;
    // Friction stops a shaft; it never turns it around.
    speed = (speed != 0.0 && next * speed < 0.0 && std::fabs(emf) <= hold) ? 0.0 : next;
    if (stalled) speed = 0.0;
    shaft += speed * dt;
    if (shaft < low || shaft > high) {
      shaft = shaft < low ? low : high;
      speed = 0.0;
    }
    current_ma = coasts ? 0.0 : std::fabs(emf) / no_load * stall_ma;
    if (stuck) return;
    const double seen = encoder_share * (reversed != encoder_wired ? before - shaft : shaft - before);
    count_edges(std::floor(encoder + unseen), std::floor(encoder + unseen + seen));
    if (open_a || open_b) {
      unseen += seen;
    } else {
      encoder += seen;
      unseen = 0.0;
    }
  }

  // Between count n and n + 1 changes track B where n is even, track A where it is odd.
  void count_edges(double from, double to) {
    const double low = std::fmin(from, to), high = std::fmax(from, to);
    const double even = std::floor((high + 1.0) / 2.0) - std::floor((low + 1.0) / 2.0);
    if (!open_b) edges_b += static_cast<uint32_t>(even);
    if (!open_a) edges_a += static_cast<uint32_t>(high - low - even);
  }

  // Every edge of one track alone turns the count around: it is one or none, by the level.
  int32_t count() const {
    const double place = std::floor(encoder);
    const int32_t counted = static_cast<int32_t>(place);
    if (!open_a && !open_b) return counted;
    if (open_a && open_b) return counted;
    return counted + (level(std::floor(encoder + unseen)) != level(place) ? 1 : 0);
  }
  // Level of the track that is not open at a count.
  bool level(double place) const {
    const int quarter = static_cast<int>(place - 4.0 * std::floor(place / 4.0));
    return open_a ? quarter == 1 || quarter == 2 : quarter >= 2;
  }
  int32_t analog(double adc_steps) const {
    const double raw = current_ma / full_scale_ma * adc_steps;
    return static_cast<int32_t>(raw > adc_steps ? adc_steps : raw);
  }
  void lose_count() { encoder = 0.0; }
};

// A tendon from a motor to a body that stands, with a load cell: T = stiffness times the way past `slack_at`.
struct TendonPlant {
  double mn_per_count = 0.0;  // 0: no cell
  double slack_at = 0.0;      // [counts]
  double pull = 1.0;          // sense that tightens
  double zero = 0.0, steps_per_mn = 1.0, period_ms = 1.0;
  double noise = 2.0;  // of the reading, in steps to either side
  bool cut = false, open = false, saturated = false, frozen = false;

  double tension_mn(double shaft) const {
    const double stretched = pull * (shaft - slack_at);
    return cut || stretched < 0.0 ? 0.0 : stretched * mn_per_count;
  }
  // A reading, of a converter of 24 bit or of an analogue input of this many steps.
  int32_t reading(double shaft, double least, double most) {
    dither = dither * 1664525u + 1013904223u;
    const double off = noise * (static_cast<double>(dither >> 8) / (1 << 23) - 1.0);
    if (open) return static_cast<int32_t>(least);
    if (saturated) return static_cast<int32_t>(most);
    const double raw = zero + steps_per_mn * tension_mn(shaft) + off;
    if (!frozen) last = static_cast<int32_t>(std::fmin(std::fmax(raw, least), most));
    return last;
  }
  uint32_t dither = 1, age_ms = 0;
  int32_t last = 0;
};

// The regulator follows its command with a lag that grows with the chamber it fills, no faster than its valve.
struct RegulatorPlant {
  double full_pa = 300000.0;  // at full duty
  double tau = 0.03;          // [s]
  double swelling = 0.3;      // more volume per bar
  double flow = 1.0e6;        // [Pa/s]
  double leak_per_s = 20.0;   // while leaking
  bool stuck = false;         // its valve: the pressure stands
  // A pair of valves at a pump: each follows its line late.
  double supply_pa = 150000.0;
  double opens_s = 0.006, shuts_s = 0.004;
  bool outlet_open = true;  // without power
  double inlet_s = 0.0, outlet_s = 0.0;
  bool inlet = false, outlet = true;
  double raw_low = 0.0, low_pa = 0.0, raw_high = 4095.0, high_pa = 300000.0;

  double pressure = 0.0;
  double rate = 0.0;
  bool leaking = false, wire_broken = false, frozen = false;
  mutable int32_t raw_last = 0;  // what a frozen read-back shows

  void step(const Output& out, double dt) {
    const double target = out.drive == Drive::RUN ? full_pa * out.duty / DUTY_FULL : 0.0;
    const double lag = tau * (1.0 + swelling * pressure / 1e5);
    double rise = (target - pressure) / lag;
    if (out.drive == Drive::VALVES || (out.drive == Drive::OFF && full_pa == 0.0)) {
      const int32_t lines = out.drive == Drive::VALVES ? out.duty : 0;
      move(inlet, inlet_s, (lines & 1) != 0, dt);
      move(outlet, outlet_s, ((lines & 2) != 0) != outlet_open, dt);
      rise = ((inlet ? supply_pa - pressure : 0.0) - (outlet ? pressure : 0.0)) / lag;
    }
    if (rise > flow) rise = flow;
    if (rise < -flow) rise = -flow;
    if (leaking) rise -= leak_per_s * pressure;
    if (stuck) rise = 0.0;
    rate = rise;
    pressure += rise * dt;
  }

  void move(bool& open, double& since_s, bool ordered, double dt) const {
    since_s = open == ordered ? 0.0 : since_s + dt;
    if (since_s >= (ordered ? opens_s : shuts_s)) open = ordered;
  }

  int32_t analog(double adc_steps) const {
    if (wire_broken) return 0;
    const double raw = raw_low + (pressure - low_pa) / (high_pa - low_pa) * (raw_high - raw_low);
    if (!frozen) raw_last = static_cast<int32_t>(raw < 0.0 ? 0.0 : (raw > adc_steps ? adc_steps : raw));
    return raw_last;
  }
};

struct Plant {
  MotorPlant motor[CHANNELS];
  RegulatorPlant regulator[CHANNELS];
  TendonPlant tendon[CHANNELS];
  int cell_of[CHANNELS] = {0, 1, 2, 3, 4, 5};  // the tendon at whose cell a channel is wired
  // The channel that drives a motor, and the motor whose encoder a channel reads: other ones where cables are swapped.
  int motor_of[CHANNELS] = {0, 1, 2, 3, 4, 5}, encoder_of[CHANNELS] = {0, 1, 2, 3, 4, 5};
  bool off = false;  // inputs are set by hand
  bool supply_low = false;
  double adc_steps = 4095.0;
  Inputs inputs = Inputs();

  // Sets one parameter by name; false when there is none of that name.
  bool set(int channel, const std::string& name, double value);
  void step(const Outputs& out, bool motors);
  // What the board reads of it now.
  void read(bool motors);
  void read_cells();
};

}  // namespace contid

#endif
