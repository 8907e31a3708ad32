// Runs a proportional pressure regulator: set-point slew, calibration table, outer loop, fault detection.
#include "regulator.h"

#include "../fixed.h"

namespace contid {

namespace {
const int32_t WIRE_MS = 20;
const int32_t OVER_MS = 20;
const int32_t FALL_PARTS = 8;     // of `over`: the least fall in `over_ms` of a chamber that vents
const int32_t FROZEN_MS = 100;    // besides the lag
const int32_t NOTICED_PARTS = 8;  // of `leak`: less than this is no motion of the reading
const int32_t SATURATED = 5;      // readings this close to the top of the input are saturated
}  // namespace

void Regulator::configure(const RegulatorConfig& config) {
  config_ = &config;
  const int32_t span = (config.raw_high - config.raw_low) * static_cast<int32_t>(WINDOW);
  slope_q16_ = static_cast<int32_t>(static_cast<int64_t>(config.high - config.low) * 65536 / span);
  for (int32_t i = 0; i + 1 < config.points; ++i) {
    const int64_t rise = static_cast<int64_t>(config.duty[i + 1] - config.duty[i]) << 20;
    duty_slope_q20_[i] = static_cast<int32_t>(rise / (config.pressure[i + 1] - config.pressure[i]));
  }
  slew_q8_ = static_cast<int32_t>(static_cast<int64_t>(config.slew) * 256 / static_cast<int32_t>(TICK_HZ));
  vent_q8_ = static_cast<int32_t>(static_cast<int64_t>(config.vent) * 256 / static_cast<int32_t>(TICK_HZ));
  trim_tick_q16_ = static_cast<int64_t>(config.trim_rate) * 256 / static_cast<int32_t>(TICK_HZ);
  trim_q16_ = 0;
  fault_ = Reason::NONE;
  leak_ticks_ = 0;
  over_ticks_ = 0;
  above_ticks_ = 0;
  if (config.valves()) pair_.configure(config);
  measure();
  for (uint32_t i = 0; i < RATE_WINDOW; ++i) past_[i] = pressure_;
  // A present set-point (of a host that reconnects) stays, below the new ceiling.
  set_q8_ = clamp64(set_q8_, 0, static_cast<int64_t>(config.ceiling) * 256);
  demand_ = static_cast<int32_t>(set_q8_ >> 8);
}

void Regulator::sense(int32_t raw_analog) {
  raw_ = raw_analog;
  if (!primed_) {
    // The average starts with the first reading, not with zeros.
    for (uint32_t i = 0; i < WINDOW; ++i) readings_[i] = raw_analog;
    reading_sum_ = raw_analog * static_cast<int32_t>(WINDOW);
    primed_ = true;
  }
  reading_sum_ += raw_analog - readings_[at_];
  readings_[at_] = raw_analog;
  at_ = (at_ + 1) % WINDOW;
  if (config_ == nullptr) return;
  measure();
  const int64_t change = static_cast<int64_t>(pressure_) - past_[past_at_];
  rate_ = static_cast<int32_t>(
      clamp64(change * (static_cast<int32_t>(TICK_HZ) / static_cast<int32_t>(RATE_WINDOW)), INT32_MIN, INT32_MAX));
  past_[past_at_] = pressure_;
  past_at_ = (past_at_ + 1) % RATE_WINDOW;
  // No chamber is below the surroundings: such a reading is a wire off, or a transmitter without supply.
  const bool broken = (config_->wire_raw > 0 && raw_ < config_->wire_raw) || raw_ >= config_->adc_steps - SATURATED ||
                      pressure_ < -config_->leak;
  wire_ticks_ = broken ? (wire_ticks_ < WIRE_MS ? wire_ticks_ + 1 : WIRE_MS) : 0;
}

void Regulator::measure() {
  const int64_t steps = reading_sum_ - config_->raw_low * static_cast<int32_t>(WINDOW);
  pressure_ = config_->low + static_cast<int32_t>((steps * slope_q16_) >> 16);
}

// The set-point stays where it is: arming never changes the pressure.
void Regulator::arm() {
  demand_ = static_cast<int32_t>(set_q8_ >> 8);
  trim_q16_ = 0;
  leak_ticks_ = 0;
  over_ticks_ = 0;
  above_ticks_ = 0;
  fault_ = Reason::NONE;
  limited_ = false;
  late_q8_ = static_cast<int32_t>(set_q8_);
  notice();
}

void Regulator::demand(int32_t pressure) {
  demand_ = clamp(pressure, 0, config_->ceiling);
  limited_ = demand_ != pressure;
}

Output Regulator::follow() {
  const int64_t error = static_cast<int64_t>(demand_) * 256 - set_q8_;
  set_q8_ += clamp64(error, -slew_q8_, slew_q8_);
  watch();
  // While the set-point moves, the error is the regulator's lag; the outer loop corrects the remaining error.
  return command(error == 0);
}

Output Regulator::hold() {
  watch();
  return command(true);
}

Output Regulator::vent() {
  set_q8_ = set_q8_ > vent_q8_ ? set_q8_ - vent_q8_ : 0;
  trim_q16_ = 0;
  if (set_q8_ == 0 || config_->valves()) return close();
  watch_rest();
  return command(false);
}

Output Regulator::close() {
  set_q8_ = 0;
  trim_q16_ = 0;
  duty_ = 0;
  watch_rest();
  return config_->valves() ? drive(pair_.empty()) : Output{Drive::COAST, 0};
}

// The duty of a pair of valves is that of its inlet.
Output Regulator::drive(const Output& valves) {
  duty_ = (valves.duty & 1) != 0 ? DUTY_FULL : 0;
  return valves;
}

// duty = table(set-point + trim); the trim integrates the error of the reading, inside its own limit and half the
// set-point. A reading outside the fault bands moves it no further: there the signal is wrong, or the chamber.
Output Regulator::command(bool settle) {
  const int32_t set = static_cast<int32_t>(set_q8_ >> 8);
  if (config_->valves()) return drive(set == 0 ? pair_.empty() : pair_.follow(set, pressure_, rate_));
  const bool in_band = pressure_ >= set - leak_band() && pressure_ <= set + config_->over;
  if (settle && config_->trim > 0 && sensor_ok() && in_band) {
    const int32_t half = set / 2;
    const int64_t limit = static_cast<int64_t>(config_->trim < half ? config_->trim : half) * 65536;
    trim_q16_ = clamp64(trim_q16_ + trim_tick_q16_ * (set - pressure_), -limit, limit);
  }
  const int32_t total = clamp(set + static_cast<int32_t>(trim_q16_ >> 16), 0, config_->ceiling);
  duty_ = duty_at(set == 0 ? 0 : total);
  return Output{Drive::RUN, duty_};
}

int32_t Regulator::duty_at(int32_t pressure) const {
  int32_t i = 0;
  while (i + 2 < config_->points && pressure >= config_->pressure[i + 1]) ++i;
  const int64_t above = pressure - config_->pressure[i];
  const int64_t duty = config_->duty[i] + ((above * duty_slope_q20_[i]) >> 20);
  return static_cast<int32_t>(clamp64(duty, 0, DUTY_FULL));
}

// What should have moved since the reading did.
void Regulator::notice() {
  noticed_ = pressure_;
  least_ = demanded();
  most_ = least_;
  least_late_q8_ = late_q8_;
  most_late_q8_ = late_q8_;
  frozen_ticks_ = 0;
}

// Whether the reading answers the set-point. A chamber is between the set-point itself and the set-point behind
// `lag_ms`; a reading that stands still while both move by `leak` is frozen, or its valve is stuck.
bool Regulator::answers() {
  late_q8_ += (static_cast<int32_t>(set_q8_) - late_q8_) / config_->lag_ms;
  if (magnitude(pressure_ - noticed_) > config_->leak / NOTICED_PARTS) {
    notice();
    return true;
  }
  const int32_t set = demanded();
  if (set < least_) least_ = set;
  if (set > most_) most_ = set;
  if (late_q8_ < least_late_q8_) least_late_q8_ = late_q8_;
  if (late_q8_ > most_late_q8_) most_late_q8_ = late_q8_;
  const bool should = most_ - least_ > config_->leak && (most_late_q8_ - least_late_q8_) / 256 > config_->leak;
  frozen_ticks_ = should ? frozen_ticks_ + 1 : 0;
  return frozen_ticks_ < FROZEN_MS + config_->lag_ms;
}

void Regulator::watch() {
  const int32_t set = static_cast<int32_t>(set_q8_ >> 8);
  leak_ticks_ = pressure_ < set - leak_band() ? leak_ticks_ + 1 : 0;
  const bool above = stays_above(set);
  const bool frozen = !answers();
  over_ticks_ = over_ceiling() ? over_ticks_ + 1 : 0;
  if (wire_ticks_ >= WIRE_MS) {
    fault_ = Reason::SENSOR_WIRE;
  } else if (over_ticks_ >= OVER_MS) {
    fault_ = Reason::OVER_PRESSURE;
  } else if (frozen) {
    fault_ = Reason::READ_BACK;
  } else if (leak_ticks_ >= config_->leak_ms) {
    fault_ = Reason::LEAK;
  } else if (above) {
    fault_ = Reason::ABOVE_SET_POINT;
    above_ticks_ = 0;  // whether it falls now that it vents is a new question
  }
}

// At rest the command falls to zero and the reading with it; it never rises above the ceiling.
void Regulator::watch_rest() {
  fault_ = Reason::NONE;
  if (!sensor_ok()) return;
  over_ticks_ = over_ceiling() ? over_ticks_ + 1 : 0;
  if (over_ticks_ >= OVER_MS) {
    fault_ = Reason::OVER_PRESSURE;
  } else if (stays_above(static_cast<int32_t>(set_q8_ >> 8))) {
    fault_ = Reason::NOT_VENTING;
  }
}

// Above the band for `over_ms` without falling by a part of it. A chamber that empties slowly does fall.
bool Regulator::stays_above(int32_t set) {
  if (pressure_ <= set + config_->over) {
    above_ticks_ = 0;
    return false;
  }
  if (above_ticks_ == 0) above_from_ = pressure_;
  if (++above_ticks_ < config_->over_ms) return false;
  if (above_from_ - pressure_ >= config_->over / FALL_PARTS) {
    above_ticks_ = 0;
    return false;
  }
  --above_ticks_;  // it stays a fault until the pressure falls
  return true;
}

bool Regulator::over_ceiling() const {
  const int32_t margin = config_->leak > config_->ceiling / 20 ? config_->leak : config_->ceiling / 20;
  return pressure_ > config_->ceiling + margin;
}

int32_t Regulator::leak_band() const {
  const int32_t half = static_cast<int32_t>(set_q8_ >> 8) / 2;
  return clamp(half, config_->leak / 4, config_->leak);
}

}  // namespace contid
