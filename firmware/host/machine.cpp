// Runs the emulated Due: boots, ticks, resets, commands, and the journal.
#include "machine.h"

#include <cmath>
#include <sstream>

#include "identity.h"

namespace contid {

namespace {

const uint32_t START_UP_MS = 20;
const uint32_t HARDWARE_WATCHDOG_MS = 32;
const double STILL_COUNTS_S = 1.0;
const double VENTED_PA = 2000.0;

const char* const STATES[] = {"off", "ready", "armed", "homing", "stopped", "safe", "pulsing"};
const char* const REASONS[] = {"none",       "watchdog",        "stalled",     "encoder_silent", "encoder_reversed",
                               "following",  "home_failed",     "sensor_wire", "leak",           "over_pressure",
                               "bridge",     "above_set_point", "not_venting", "encoder_edges",  "home_twice",
                               "home_moved", "encoder_track",   "read_back",   "cell",           "cell_frozen",
                               "cell_other", "slack",           "snap",        "over_tension"};
const char* const CAUSES[] = {"power_up", "backup", "watchdog", "software", "pin", "brown_out"};

}  // namespace

void Machine::boot(ResetCause cause, uint32_t uptime_ms) {
  // A loss of power clears the counter of starts, as it does in the chip's backup register.
  boots_ = cause == ResetCause::POWER_UP ? static_cast<uint16_t>(1) : static_cast<uint16_t>(boots_ + 1);
  Identity identity = emulated_identity(role_);
  identity.boot = boots_;
  identity.boot_id = boot_id_++;
  identity.cause = cause;
  identity.adc_steps = parts_.adc_steps;
  identity.adc_mv = parts_.adc_mv;
  if (parts_.bridges >= 0) identity.bridges = static_cast<uint8_t>(parts_.bridges);
  for (uint8_t& capability : identity.capabilities) {
    if (parts_.capabilities >= 0) capability = static_cast<uint8_t>(parts_.capabilities);
  }
  board_.start(identity, nullptr, nullptr, uptime_ms);
  link_.start();
  other_port_.start(PortId::PROGRAMMING);
  board_.clock(since_tick_us_);
  outputs_ = Outputs();
  for (Output& out : outputs_.channel) out.drive = Drive::OFF;
  unfed_ms_ = 0;
  frozen_ms_ = 0;
  ticked_ = false;
  for (int i = 0; i < CHANNELS; ++i) {
    state_[i] = State::OFF;
    reason_[i] = Reason::NONE;
  }
  std::fprintf(journal_, "{\"world_ms\": %llu, \"event\": \"boot\", \"boot\": %u, \"cause\": \"%s\"}\n",
               static_cast<unsigned long long>(world_ms_), boots_, CAUSES[static_cast<int>(cause)]);
  std::fflush(journal_);
}

void Machine::reset(ResetCause cause, uint32_t uptime_ms) {
  for (MotorPlant& motor : plant.motor) motor.lose_count();
  boot(cause, uptime_ms);
  starting_ms_ = START_UP_MS;
}

void Machine::tick() {
  ++world_ms_;
  if (starting_ms_ > 0) {
    --starting_ms_;
  } else {
    board_.tick(plant.inputs, outputs_);
    ticked_ = true;
  }
  plant.step(outputs_, role_ == Role::MOTOR);
  note();
  if (frozen_ms_ > 0) {
    --frozen_ms_;
    if (++unfed_ms_ >= HARDWARE_WATCHDOG_MS && watchdog_fires_) reset(ResetCause::WATCHDOG);
  } else {
    unfed_ms_ = 0;
  }
}

// A line for every change of a channel's state, and when its part of the world came to rest afterwards.
void Machine::note() {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const MotorPlant& m = plant.motor[i];
    const RegulatorPlant& r = plant.regulator[i];
    const bool motor = role_ == Role::MOTOR;
    const double value = motor ? m.shaft : r.pressure;
    const double rate = motor ? m.speed : r.rate;
    const bool rests = motor ? std::fabs(rate) < STILL_COUNTS_S : r.pressure < VENTED_PA;
    const bool changed = board_.state(i) != state_[i] || board_.reason(i) != reason_[i];
    if (changed) {
      state_[i] = board_.state(i);
      reason_[i] = board_.reason(i);
      std::fprintf(journal_,
                   "{\"world_ms\": %llu, \"event\": \"state\", \"channel\": %d, \"state\": \"%s\", \"reason\": \"%s\", "
                   "\"silence_ms\": %u, \"value\": %.3f, \"rate\": %.3f}\n",
                   static_cast<unsigned long long>(world_ms_), i, STATES[static_cast<int>(state_[i])],
                   REASONS[static_cast<int>(reason_[i])], board_.silence_ms(), value, rate);
    }
    if (rests && (!resting_[i] || changed) && state_[i] != State::OFF) {
      std::fprintf(journal_, "{\"world_ms\": %llu, \"event\": \"rest\", \"channel\": %d, \"value\": %.3f}\n",
                   static_cast<unsigned long long>(world_ms_), i, value);
      std::fflush(journal_);
    }
    if (changed) std::fflush(journal_);
    resting_[i] = rests;
  }
}

void Machine::take(uint8_t byte, std::vector<uint8_t>& reply, PortId port) {
  Link& link = port == PortId::NATIVE ? link_ : other_port_;
  const size_t size = link.take(byte, board_);
  reply.insert(reply.end(), link.reply(), link.reply() + size);
}

bool Machine::command(const std::string& line, std::string& out) {
  std::istringstream in(line);
  std::string verb, name;
  int channel = 0;
  double value = 0.0;
  if (!(in >> verb)) return true;
  if (verb == "reset") return reset(ResetCause::PIN), true;
  if (verb == "old" && in >> value) return reset(ResetCause::POWER_UP, static_cast<uint32_t>(value)), true;
  if (verb == "brown_out") return reset(ResetCause::BROWN_OUT), true;
  if (verb == "power_cycle") return reset(ResetCause::POWER_UP), true;
  if (verb == "freeze") {
    if (!(in >> value)) value = 1e9;
    return freeze(static_cast<uint32_t>(value)), true;
  }
  if (verb == "supply_low") {
    in >> plant.supply_low;
    plant.read(role_ == Role::MOTOR);
    return true;
  }
  if (verb == "watchdog") return in >> watchdog_fires_, true;
  if (verb == "set" && in >> channel >> name >> value && channel >= 0 && channel < CHANNELS) {
    const bool known = plant.set(channel, name, value);
    plant.read(role_ == Role::MOTOR);
    return known;
  }
  if (verb == "silent" && in >> channel >> value && channel >= 0 && channel < CHANNELS) {
    return board_.fit(static_cast<uint8_t>(channel), value != 0.0 ? 0 : emulated_capability(role_)), true;
  }
  if (verb == "input" && in >> name >> channel >> value && channel >= 0 && channel < CHANNELS) {
    plant.off = true;
    (name == "count" ? plant.inputs.count : plant.inputs.analog)[channel] = static_cast<int32_t>(value);
    return true;
  }
  if (verb == "get" && in >> channel && channel >= 0 && channel < CHANNELS) {
    char text[200];
    const MotorPlant& m = plant.motor[channel];
    const Output& o = outputs_.channel[channel];
    std::snprintf(text, sizeof text, "%.6f %.6f %.3f %.3f %d %d %llu", m.shaft, m.speed,
                  plant.regulator[channel].pressure, plant.regulator[channel].rate, static_cast<int>(o.drive), o.duty,
                  static_cast<unsigned long long>(world_ms_));
    out = text;
    return true;
  }
  return false;
}

}  // namespace contid
