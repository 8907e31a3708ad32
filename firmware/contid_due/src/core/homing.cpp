// Homing of a motor: its end stop is found twice, with a way back between.
//
// | phase          | the shaft goes                    | until                          | then           |
// |----------------|-----------------------------------|--------------------------------|----------------|
// | IDLE           | follows, or rests                 | home()                         | APPROACH       |
// | APPROACH       | to the stop, at the homing speed  | it stands: `home_at`           | BACK_OFF       |
// | BACK_OFF       | `home_backoff` away from the stop | it is there                    | APPROACH_AGAIN |
// | APPROACH_AGAIN | as APPROACH                       | it stands: `home_at`           | BACK_OFF_AGAIN |
// | BACK_OFF_AGAIN | as BACK_OFF                       | it is there                    | FOUND          |
// | FOUND          | stands                            | hold(), of the board           | IDLE           |
// | each           |                                   | arm(), hold(), rest(), a fault | IDLE           |
//
// Faults besides those of the law: HOME_FAILED when an approach lasts `home_timeout_ms`, or a shaft that backs off has
// not come SETTLE_MS after its set-point; HOME_TWICE when the stop is elsewhere at the second time; HOME_MOVED when it
// is elsewhere at the first, and was known; that of a load cell.
#include "fixed.h"
#include "motor.h"

namespace contid {

namespace {
const int32_t STILL_MS = 50;    // pushing against the end stop without an advance of the count
const int32_t STOPPED_MS = 25;  // the same of a shaft that had moved, and time for STILL_COUNTS at homing speed
const int32_t STILL_COUNTS = 4;
const int32_t SETTLE_MS = 2000;
}  // namespace

void Motor::home() {
  begin();
  homed_ = false;
  missed_base_ = raw_missed_;
  enter(Phase::APPROACH);
}

void Motor::enter(Phase phase) {
  phase_ = phase;
  phase_ticks_ = 0;
  still_ticks_ = 0;
  set_.limit(config_->home_velocity, config_->acceleration);
  // The duty that a shaft which searches its stop may need to move, or to leave the stop.
  const int32_t most = config_->home_duty - config_->home_duty / 8;
  watch_.start(position_, most < config_->stall_duty ? most : config_->stall_duty);
}

void Motor::end_homing() {
  if (phase_ == Phase::IDLE) return;
  phase_ = Phase::IDLE;
  set_.limit(config_->velocity, config_->acceleration);
  watch_.start(position_, config_->stall_duty);
}

void Motor::hold() {
  // The set-point of a search lies ahead of the shaft, possibly inside the end stop: it is given up.
  const bool searching = approaches() || backs_off();
  end_homing();
  if (searching) {
    begin();
  } else {
    set_.stop();
  }
}

Output Motor::search() {
  if (config_->tension.fitted && tendon_.cell_fault() != Reason::NONE) {
    fault_ = tendon_.cell_fault();
    return Output{Drive::BRAKE, 0};
  }
  return approaches() ? approach() : back_off();
}

Output Motor::approach() {
  const int32_t towards = config_->home_up ? 1 : -1;
  // Slightly ahead of the shaft: it moves at the homing speed without a large error.
  set_.demand(plus(position_, towards * (config_->home_velocity / 8 + config_->deadband + 64)), 0, NO_VELOCITY);
  set_.tick();
  const Output out = law(config_->home_duty);
  const bool pushing = magnitude(duty_) * 20 >= config_->home_duty * 19;
  still_ticks_ = (pushing && sign(duty_) == towards) ? still_ticks_ + 1 : 0;
  const int32_t still = still_ms();
  if (still_ticks_ < still || watch_.idle() < still + static_cast<int32_t>(WINDOW)) {
    if (++phase_ticks_ >= config_->home_timeout_ms) fault_ = Reason::HOME_FAILED;
    return out;
  }
  const bool again = phase_ == Phase::APPROACH_AGAIN;
  const int64_t off = static_cast<int64_t>(position_) - config_->home_at;
  if ((again || known_) && magnitude64(off) > config_->home_repeat) {
    fault_ = again ? Reason::HOME_TWICE : Reason::HOME_MOVED;
    return Output{Drive::BRAKE, 0};
  }
  count_from(config_->home_at);
  begin();
  set_.demand(minus(position_, towards * config_->home_backoff), 0, NO_VELOCITY);
  enter(again ? Phase::BACK_OFF_AGAIN : Phase::BACK_OFF);
  return Output{Drive::BRAKE, 0};
}

int32_t Motor::still_ms() const {
  if (!watch_.advanced()) return STILL_MS;  // it may have to break away first
  return clamp(STILL_COUNTS * static_cast<int32_t>(TICK_HZ) / config_->home_velocity, STOPPED_MS, STILL_MS);
}

Output Motor::back_off() {
  set_.tick();
  const Output out = law(config_->home_duty);
  const bool arrived = !set_.moving() && set_.position() == set_.goal();
  const int64_t off = static_cast<int64_t>(set_.goal()) - position_;
  still_ticks_ = arrived ? still_ticks_ + 1 : 0;
  if (arrived && magnitude64(off) <= config_->deadband + 1) {
    if (phase_ == Phase::BACK_OFF_AGAIN) {
      phase_ = Phase::FOUND;
      homed_ = true;
      known_ = true;
    } else {
      begin();
      enter(Phase::APPROACH_AGAIN);
    }
  } else if (still_ticks_ >= SETTLE_MS) {
    fault_ = Reason::HOME_FAILED;
  }
  return out;
}

}  // namespace contid
