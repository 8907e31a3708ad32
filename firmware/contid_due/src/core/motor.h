// A geared motor with encoder: position law, faults (motor.cpp), homing (homing.cpp). In counts and ticks; no floating
// point.
#ifndef CONTID_MOTOR_H
#define CONTID_MOTOR_H

#include "config.h"
#include "encoder_watch.h"
#include "setpoint.h"
#include "tension/tendon.h"

namespace contid {

enum class Drive : uint8_t { COAST = 0, BRAKE = 1, RUN = 2, OFF = 3, VALVES = 4 };

struct Output {
  Drive drive;
  int32_t duty;  // signed for motors, 0 .. DUTY_FULL for regulators; VALVES: 1 the inlet has power, 2 the outlet
};

class Motor {
 public:
  // `power_up` sets the count once after a start; a later configuration keeps the count. One that changes what the
  // count means loses the position.
  void configure(const MotorConfig& config);
  // The channel is not part of the configuration any more: counts only.
  void unconfigure() { config_ = nullptr; }
  void sense(int32_t raw_count, int32_t raw_analog, uint32_t raw_missed, const CellReading& cell);

  // Each of these ends a homing that is under way: its speed, its duty limit and its watches go with it.
  void arm();
  void hold();
  void demand(int32_t goal, uint32_t since, int32_t velocity);
  void home();

  // One step of the position law under power.
  Output follow();
  Output rest(Drive drive);
  // Open loop: this duty, whatever the encoder shows.
  Output pulse(int32_t duty);
  // One step of homing; it ends with search_done() or a fault.
  Output search();
  bool search_done() const { return phase_ == Phase::FOUND; }

  // Fault while under power.
  Reason fault() const { return fault_; }

  int32_t position() const { return position_; }
  int32_t velocity() const;
  int32_t duty() const { return duty_; }
  int32_t current_ma() const { return current_; }
  // Encoder edges missed since the position was known.
  uint32_t missed_edges() const { return raw_missed_ - missed_base_; }
  bool homed() const { return homed_; }
  // A count that started at an unknown position: neither homed nor parked.
  bool lost() const { return lost_ && !homed_; }
  void lose() {
    lost_ = true;
    known_ = false;
  }
  // The shaft is at `power_up` now.
  void park();
  bool limited() const { return limited_ || (tendon() != nullptr && set_.fenced()); }
  // The tendon that it pulls, of a configuration with a load cell.
  const Tendon* tendon() const { return config_ != nullptr && config_->tension.fitted ? &tendon_ : nullptr; }
  // It may be driven: no load cell, or one that shows a tension.
  bool feels() const { return tendon() == nullptr || (tendon_.ok() && tendon_.cell_fault() == Reason::NONE); }
  // Another tendon answers at its cell.
  void disown() { disowned_ = true; }

 private:
  // Of homing; the table of its transitions: homing.cpp.
  enum class Phase : uint8_t { IDLE, APPROACH, BACK_OFF, APPROACH_AGAIN, BACK_OFF_AGAIN, FOUND };
  void enter(Phase phase);
  Output approach();
  Output back_off();
  void end_homing();
  int32_t still_ms() const;
  bool approaches() const { return phase_ == Phase::APPROACH || phase_ == Phase::APPROACH_AGAIN; }
  bool backs_off() const { return phase_ == Phase::BACK_OFF || phase_ == Phase::BACK_OFF_AGAIN; }

  // Each missed edge is two counts; from this number on the position is useless.
  static const uint32_t MISSED_EDGES = 8;
  bool missed() const { return missed_edges() >= MISSED_EDGES; }

  static const uint32_t WINDOW = 8;

  void count_from(int32_t position);
  void stand();
  void begin();
  Output law(int32_t max_duty);
  void break_away(int32_t side, int32_t error);
  void watch(int64_t error_q8, bool resting);
  Output driven(int32_t duty);
  void feel(bool spent);
  Reason ails(int64_t error_q8) const;
  bool senses_current() const { return config_->stall_current_ma != 0; }
  bool draws_stall() const { return current_ >= config_->stall_current_ma; }

  int32_t counted() const;

  const MotorConfig* config_;
  bool reversed_;  // sense and scale of the count when it was referenced
  int32_t power_up_, home_at_;
  SetPoint set_;
  Tendon tendon_;
  EncoderWatch watch_;
  uint32_t raw_missed_, missed_base_;  // the base: when the position was known last
  int32_t raw_, offset_, position_;
  int32_t history_[WINDOW];
  uint32_t at_;
  int32_t moved_;     // counts in the last WINDOW ticks
  int64_t speed_q8_;  // filtered [counts/s] times 256
  int64_t sum_q16_;   // integrator, duty times 65536
  int32_t ki_tick_;
  int32_t extra_;  // duty that breaks a standing shaft away
  int32_t duty_, current_;
  int32_t stall_ticks_, phase_ticks_, still_ticks_;
  Phase phase_;
  Reason fault_;
  bool referenced_, homed_, limited_, lost_;
  bool disowned_;
  bool known_;  // the count agrees with an end stop that was found earlier
};

}  // namespace contid

#endif
