// A proportional pressure regulator, or a pair of valves: slew, calibration, ceiling, read-back faults, optional outer
// loop.
#ifndef CONTID_REGULATOR_H
#define CONTID_REGULATOR_H

#include "../config.h"
#include "../motor.h"
#include "valve_pair.h"

namespace contid {

class Regulator {
 public:
  void configure(const RegulatorConfig& config);
  // The channel is not part of the configuration any more: reads only. Its chamber is empty when it returns.
  void unconfigure() {
    config_ = nullptr;
    set_q8_ = 0;
  }
  void sense(int32_t raw_analog);

  void arm();
  void demand(int32_t pressure);

  // The set-point goes to the demand at the slew rate, stays, or falls to zero at the venting rate.
  Output follow();
  Output hold();
  Output vent();
  // Sets the command to zero at once.
  Output close();

  // Fault of the newest step, under a set-point and at rest.
  Reason fault() const { return fault_; }
  bool sensor_ok() const { return primed_ && wire_ticks_ == 0; }

  int32_t pressure() const { return pressure_; }
  int32_t rate() const { return rate_; }
  int32_t duty() const { return duty_; }
  int32_t raw() const { return raw_; }
  bool limited() const { return limited_; }

 private:
  static const uint32_t WINDOW = 8;
  static const uint32_t RATE_WINDOW = 16;

  Output command(bool settle);
  Output drive(const Output& valves);
  void measure();
  void watch();
  void watch_rest();
  bool stays_above(int32_t set);
  bool over_ceiling() const;
  void notice();
  bool answers();
  int32_t demanded() const { return static_cast<int32_t>(set_q8_ >> 8); }
  // Distance below the set-point that is a fault; shorter at low set-points, where a broken signal reads little less.
  int32_t leak_band() const;
  int32_t duty_at(int32_t pressure) const;

  const RegulatorConfig* config_;
  int32_t slope_q16_;  // Pa per step of the summed reading, times 65536
  int32_t duty_slope_q20_[TABLE_POINTS];
  int32_t slew_q8_, vent_q8_;  // Pa times 256 per tick
  int64_t trim_tick_q16_;
  int32_t readings_[WINDOW];
  int32_t reading_sum_;
  int32_t past_[RATE_WINDOW];
  uint32_t at_, past_at_;
  int32_t raw_, pressure_, rate_;
  int32_t demand_;
  int64_t set_q8_;
  int64_t trim_q16_;
  int32_t duty_;
  ValvePair pair_;
  int32_t wire_ticks_, leak_ticks_, over_ticks_, above_ticks_, above_from_;
  int32_t noticed_;                                      // the reading when it moved last
  int32_t late_q8_;                                      // the set-point behind the lag of the volume
  int32_t least_, most_, least_late_q8_, most_late_q8_;  // ranges of both since then
  int32_t frozen_ticks_;                                 // how long the reading should have moved
  Reason fault_;
  bool limited_, primed_;
};

}  // namespace contid

#endif
