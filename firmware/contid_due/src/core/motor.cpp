// Runs a geared motor with encoder: speed estimate, position and speed law, faults. Its homing: homing.cpp.
//
// Faults of a driven shaft, the first that holds:
//
// | reason                     | when                                                                               |
// |----------------------------|------------------------------------------------------------------------------------|
// | ENCODER_EDGES              | edges were missed since the position was known                                     |
// | ENCODER_REVERSED           | the count owes what the drive must have caused (EncoderWatch), and runs backward   |
// | ENCODER_TRACK              | it owes, and goes to and fro                                                       |
// | STALLED or ENCODER_SILENT  | it owes, and stands: without a current sensor STALLED                              |
// |                            | - those below not while a search approaches its stop -                             |
// | STALLED or ENCODER_SILENT  | pushes without a count for `stall_ms`, or SILENT_MS if farther off than `follow`:  |
// |                            | with a current sensor ENCODER_SILENT unless the stall current flows                |
// | FOLLOWING                  | farther from its set-point than `follow`                                           |
// | CELL_OTHER, of the tendon  | no fault yet, and its load cell or tendon has one (Tendon::fault)                  |
#include "motor.h"

#include "fixed.h"

namespace contid {

namespace {
const int32_t SILENT_MS = 20;  // following error without a count

// A shaft that stands and should not: the duty goes on by BREAK_AWAY per tick and count of error, STUCK at most.
const int32_t STUCK_MS = 10;
const int32_t STUCK = 4;
const int32_t BREAK_AWAY = 49;  // 600 % per second at most
}  // namespace

int32_t Motor::counted() const { return config_->encoder_reversed ? minus(0, raw_) : raw_; }

void Motor::configure(const MotorConfig& config) {
  config_ = &config;
  set_.limit(config.velocity, config.acceleration);
  ki_tick_ = static_cast<int32_t>(static_cast<int64_t>(config.ki) * 65536 / static_cast<int32_t>(TICK_HZ));
  watch_.configure(config);
  const int32_t position = referenced_ ? plus(counted(), offset_) : config.power_up;
  if (!referenced_) {
    missed_base_ = raw_missed_;
    referenced_ = true;
  } else if (config.encoder_reversed != reversed_ || config.power_up != power_up_ || config.home_at != home_at_) {
    homed_ = false;
    lose();
  }
  reversed_ = config.encoder_reversed;
  power_up_ = config.power_up;
  home_at_ = config.home_at;
  count_from(position);
  const int64_t held_q16 = sum_q16_;
  stand();
  sum_q16_ = held_q16;  // a motor that holds a load goes on holding it
  speed_q8_ = 0;
  fault_ = Reason::NONE;
  phase_ = Phase::IDLE;
  watch_.start(position_, config.stall_duty);
  if (config.tension.fitted) tendon_.configure(config.tension, position_);
}

void Motor::sense(int32_t raw_count, int32_t raw_analog, uint32_t raw_missed, const CellReading& cell) {
  raw_ = raw_count;
  raw_missed_ = raw_missed;
  if (config_ == nullptr) return;
  if (missed()) {
    homed_ = false;
    lose();
  }
  position_ = plus(counted(), offset_);
  moved_ = minus(position_, history_[at_]);
  history_[at_] = position_;
  at_ = (at_ + 1) % WINDOW;
  const int64_t speed_q8 =
      static_cast<int64_t>(moved_) * (256 * static_cast<int32_t>(TICK_HZ) / static_cast<int32_t>(WINDOW));
  speed_q8_ += (speed_q8 - speed_q8_) / 4;
  current_ = raw_analog * config_->full_scale_ma / config_->adc_steps;
  if (config_->tension.fitted) tendon_.sense(cell, position_);
}

int32_t Motor::velocity() const {
  // A counter that jumps (a cable, a reset chip) must not overflow the values computed from its speed.
  const int64_t limit = 1 << 24;
  return static_cast<int32_t>(clamp64(speed_q8_ >> 8, -limit, limit));
}

// The shaft is at `position` now.
void Motor::count_from(int32_t position) {
  offset_ = minus(position, counted());
  position_ = position;
  for (int32_t& past : history_) past = position;
}

// The set-point stands at the shaft, without duty.
void Motor::stand() {
  set_.start(position_);
  sum_q16_ = 0;
  extra_ = 0;
  duty_ = 0;
}

// Stands at the shaft; watches and fault start anew.
void Motor::begin() {
  stand();
  stall_ticks_ = 0;
  fault_ = Reason::NONE;
  limited_ = false;
  watch_.start(position_, config_->stall_duty);
  disowned_ = false;
  if (config_->tension.fitted) tendon_.arm(position_);
}

void Motor::arm() {
  end_homing();
  begin();
}

void Motor::demand(int32_t goal, uint32_t since, int32_t velocity) {
  const int32_t allowed = clamp(goal, config_->low, config_->high);
  limited_ = allowed != goal;
  if (velocity != NO_VELOCITY && since > 0) {
    // The line goes on for two intervals: it must not leave the travel.
    const int64_t ahead = 2 * static_cast<int64_t>(since);
    const int64_t down = (static_cast<int64_t>(config_->low) - allowed) * static_cast<int32_t>(TICK_HZ) / ahead;
    const int64_t up = (static_cast<int64_t>(config_->high) - allowed) * static_cast<int32_t>(TICK_HZ) / ahead;
    velocity = static_cast<int32_t>(clamp64(velocity, down, up));
  }
  set_.demand(allowed, since, velocity);
}

void Motor::park() {
  count_from(config_->power_up);
  missed_base_ = raw_missed_;
  lost_ = false;
  begin();
}

Output Motor::rest(Drive drive) {
  end_homing();
  stand();
  return Output{drive, 0};
}

Output Motor::pulse(int32_t duty) {
  rest(Drive::RUN);
  feel(false);
  return driven(duty);
}

Output Motor::follow() {
  if (!config_->tension.fitted) {
    set_.tick();
    return law(DUTY_FULL);
  }
  // The faster of both that pays out: the shaft may run on behind its set-point.
  const int64_t shaft = static_cast<int64_t>(velocity()) * 65536 / static_cast<int32_t>(TICK_HZ);
  const bool runs_on = config_->tension.pull * (shaft - set_.speed_q16()) < 0;
  Fence fence = tendon_.fence(runs_on ? shaft : set_.speed_q16());
  fence.at = clamp64(fence.at, static_cast<int64_t>(config_->low) * 65536, static_cast<int64_t>(config_->high) * 65536);
  set_.tick(&fence);
  const Output out = law(DUTY_FULL);
  feel(set_.spent());
  return out;
}

// What ails the tendon or its cell, unless the motor has a fault already.
void Motor::feel(bool spent) {
  if (!config_->tension.fitted) return;
  tendon_.watch(spent);
  if (fault_ == Reason::NONE) fault_ = disowned_ ? Reason::CELL_OTHER : tendon_.fault();
}

// Puts out a duty; none that slackens a tendon whose cell shows no tension.
Output Motor::driven(int32_t duty) {
  duty_ = config_->tension.fitted ? tendon_.allowed(duty) : duty;
  return Output{Drive::RUN, config_->motor_reversed ? -duty_ : duty_};
}

// Position and speed law, with the set-point's position, velocity v* and acceleration a*:
//
//   v = v* + kp (position error), no faster than the velocity limit
//   duty = kv v + ka a* + ks (v - v_measured) + ki integral(v - v_measured) + friction sign(v)
//
// The inner speed loop keeps a shaft that catches up below the limit.
Output Motor::law(int32_t max_duty) {
  const int64_t error_q8 = clamp64((set_.position_q16() - static_cast<int64_t>(position_) * 65536) >> 8,
                                   -(static_cast<int64_t>(1) << 30), static_cast<int64_t>(1) << 30);
  const bool near = magnitude64(error_q8) <= static_cast<int64_t>(config_->deadband) * 256;
  // At rest inside the dead band nothing is corrected: the integrator would hunt against the friction.
  // A tension below its floor is not at rest.
  const bool tightens = config_->tension.fitted && set_.fenced() && !set_.spent() && tendon_.below();
  const bool resting = !set_.moving() && near && moved_ == 0 && !tightens;
  const int64_t catching_up = resting ? 0 : (config_->kp * error_q8) >> 16;
  const int32_t target =
      static_cast<int32_t>(clamp64(set_.velocity() + catching_up, -config_->velocity, config_->velocity));
  const int64_t e = resting ? 0 : target - velocity();

  break_away(resting ? 0 : sign(error_q8), static_cast<int32_t>(magnitude64(error_q8) >> 8) - config_->deadband);
  int64_t duty = (sum_q16_ >> 16) + extra_;
  duty += (static_cast<int64_t>(config_->kv) * target) >> 8;
  duty += (static_cast<int64_t>(config_->ka) * set_.acceleration()) >> 16;
  duty += (config_->ks * e) >> 8;
  duty += config_->friction * sign(target);

  const int64_t limited = clamp64(duty, -max_duty, max_duty);
  const bool winds_up = duty != limited && sign(e) == sign(duty);
  if (!winds_up) {
    const int64_t full = static_cast<int64_t>(DUTY_FULL) * 65536;
    sum_q16_ = clamp64(sum_q16_ + ((ki_tick_ * e) >> 8), -full, full);
  }
  const Output out = driven(static_cast<int32_t>(limited));
  watch(error_q8, resting);
  return out;
}

// More duty for a shaft that stands `error` counts beyond the dead band. Half of it stays with the integrator when the
// shaft moves: the drive went on while it broke away.
void Motor::break_away(int32_t side, int32_t error) {
  const bool stands = watch_.idle() > STUCK_MS;
  if (stands && side != 0 && error > 0) {
    extra_ = clamp(extra_ + side * BREAK_AWAY * (error < STUCK ? error : STUCK), -DUTY_FULL, DUTY_FULL);
  } else if (extra_ != 0) {
    if (!stands) sum_q16_ += static_cast<int64_t>(extra_) * 32768;
    extra_ = 0;
  }
}

void Motor::watch(int64_t error_q8, bool resting) {
  const bool pushing = magnitude(duty_) >= config_->stall_duty;
  stall_ticks_ = (pushing && moved_ == 0) ? stall_ticks_ + 1 : 0;
  if (resting) {
    watch_.rest(position_);
  } else {
    // Homing searches for standstill under drive, and the stall current shows what blocks a shaft.
    watch_.tick(position_, moved_, duty_, (senses_current() && draws_stall()) || approaches());
  }
  const Reason reason = ails(error_q8);
  if (reason != Reason::NONE) fault_ = reason;
}

Reason Motor::ails(int64_t error_q8) const {
  if (missed()) return Reason::ENCODER_EDGES;
  if (watch_.failed()) {
    if (watch_.backward()) return Reason::ENCODER_REVERSED;
    if (watch_.one_track()) return Reason::ENCODER_TRACK;
    return senses_current() ? Reason::ENCODER_SILENT : Reason::STALLED;
  }
  if (approaches()) return Reason::NONE;
  const bool lost = magnitude64(error_q8) > static_cast<int64_t>(config_->follow) * 256;
  if (stall_ticks_ >= config_->stall_ms || (lost && stall_ticks_ >= SILENT_MS)) {
    // A blocked shaft draws the stall current; one that turns with a dead encoder does not.
    return senses_current() && !draws_stall() ? Reason::ENCODER_SILENT : Reason::STALLED;
  }
  return lost ? Reason::FOLLOWING : Reason::NONE;
}

}  // namespace contid
