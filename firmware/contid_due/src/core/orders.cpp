// Handlers of the requests: each is read and checked completely before it changes any state.
#include <string.h>

#include "board.h"

namespace contid {

namespace {
Safe rest_of_stop(Rest rest, Role role) {
  if (rest == Rest::HOLD) return Safe::HOLD;
  if (role == Role::MOTOR) return Safe::COAST;
  return rest == Rest::VENT ? Safe::VENT : Safe::CLOSE;
}
}  // namespace

Verdict Board::check_crc(Reader& in) const {
  const uint16_t crc = in.u16();
  if (config_.mask == 0) return Verdict{Refusal::NOT_CONFIGURED, 0};
  if (!in.ok() || crc != config_crc_) return Verdict{Refusal::WRONG_CRC, config_crc_};
  return accepted();
}

Verdict Board::check_mask(uint8_t mask) const {
  if ((mask & ~static_cast<uint32_t>(config_.mask)) != 0) return Verdict{Refusal::BAD_CHANNEL, mask};
  return accepted();
}

// The body of a request that names channels only.
Verdict Board::read_mask(Reader& in, uint8_t& mask) const {
  const Verdict verdict = check_crc(in);
  if (verdict.refusal != Refusal::NONE) return verdict;
  mask = in.u8();
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  return check_mask(mask);
}

Verdict Board::configure(Reader& in) {
  const size_t body = in.left();
  if (body < CRC_SIZE) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(body)};
  const uint16_t crc = in.u16();
  const uint16_t computed = in.crc_of_rest();
  if (crc != computed) return Verdict{Refusal::WRONG_CRC, computed};
  memset(static_cast<void*>(&staged_), 0, sizeof(staged_));
  const Verdict verdict = read_config(in, identity_.role, identity_.adc_steps, staged_);
  if (verdict.refusal != Refusal::NONE) return verdict;
  // The same configuration again changes nothing, for a host that reconnects.
  if (config_.mask != 0 && crc == config_crc_) return accepted();
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((staged_.mask & (1u << i)) != 0 && !fitted(i)) return Verdict{Refusal::BAD_CHANNEL, i};
    if (moves(i) || (powered(i) && staged_loses(i))) return Verdict{Refusal::ARMED_NOW, i};
  }
  block_tick();
  config_ = staged_;
  cells_.reset();
  config_crc_ = crc;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((config_.mask & (1u << i)) == 0) {
      channel_[i].state = State::OFF;
      channel_[i].reason = Reason::NONE;
      // Its former configuration is zeros now.
      motor_[i].unconfigure();
      regulator_[i].unconfigure();
      continue;
    }
    // A latched channel stays latched until clear.
    if (channel_[i].state == State::OFF) channel_[i].state = State::READY;
    // What holds goes on holding, and what does not gets no power.
    if (!powered(i) && channel_[i].state != State::STOPPED) channel_[i].rest = rest_of_start(i);
    if (identity_.role == Role::MOTOR) {
      motor_[i].configure(config_.motor[i]);
    } else {
      regulator_[i].configure(config_.regulator[i]);
    }
  }
  allow_tick();
  return accepted();
}

// A motor that holds its position would run away, fall, or forget where it is. Pressure that is let go is safe.
bool Board::staged_loses(uint8_t i) const {
  if (identity_.role != Role::MOTOR) return false;
  if ((staged_.mask & (1u << i)) == 0) return true;
  const MotorConfig &now = config_.motor[i], &then = staged_.motor[i];
  return then.bridge != now.bridge || then.motor_reversed != now.motor_reversed ||
         then.encoder_reversed != now.encoder_reversed || then.power_up != now.power_up || then.home_at != now.home_at;
}

Verdict Board::check_each(uint8_t mask, Verdict (Board::*may)(uint8_t channel) const) const {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0) continue;
    const Verdict verdict = (this->*may)(i);
    if (verdict.refusal != Refusal::NONE) return verdict;
  }
  return accepted();
}

Verdict Board::check_arm(uint8_t i) const {
  if (pulse_.active()) return Verdict{Refusal::ARMED_NOW, pulse_.channel()};
  if (channel_[i].state == State::SAFE) return Verdict{Refusal::LATCHED, i};
  if (!fitted(i)) return Verdict{Refusal::BAD_CHANNEL, i};
  if ((bridge_faults_ & (1u << i)) != 0) return Verdict{Refusal::PERSISTS, i};
  if (identity_.role == Role::MOTOR) {
    if (channel_[i].state == State::HOMING) return Verdict{Refusal::ARMED_NOW, i};
    if (config_.motor[i].homing && !motor_[i].homed()) return Verdict{Refusal::NOT_HOMED, i};
    if (lost(i)) return Verdict{Refusal::POSITION_LOST, i};
    if (!feels(i)) return Verdict{Refusal::NO_SENSOR, i};
  } else if (!regulator_[i].sensor_ok()) {
    return Verdict{Refusal::NO_SENSOR, i};
  }
  return accepted();
}

Verdict Board::arm(Reader& in) {
  uint8_t mask = 0;
  Verdict verdict = read_mask(in, mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  block_tick();
  verdict = check_each(mask, &Board::check_arm);
  if (verdict.refusal != Refusal::NONE) {
    allow_tick();
    return verdict;
  }
  if (!commanded()) feed();  // what is commanded already needs a host that reads
  demanded_ = now_;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0 || channel_[i].state == State::ARMED) continue;
    if (identity_.role == Role::MOTOR) {
      motor_[i].arm();
    } else {
      regulator_[i].arm();
    }
    channel_[i] = Channel{State::ARMED, Reason::NONE, Safe::HOLD};
  }
  allow_tick();
  return accepted();
}

Verdict Board::demand(Reader& in) {
  Verdict verdict = check_crc(in);
  if (verdict.refusal != Refusal::NONE) return verdict;
  const uint32_t echo = in.u32();
  const uint8_t mask = in.u8();
  int32_t value[CHANNELS] = {0, 0, 0, 0, 0, 0};
  int32_t velocity[CHANNELS] = {0, 0, 0, 0, 0, 0};
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0) continue;
    value[i] = in.i32();
    velocity[i] = in.i32();
  }
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  verdict = check_mask(mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  block_tick();
  // The host echoes the uptime of the newest telemetry it read. A demand with an old echo (the host does not read,
  // or the demand waited in a buffer) commands nothing and does not feed the watchdog.
  stale_ = now_ - echo >= static_cast<uint32_t>(config_.watchdog_ms);
  if (!stale_) {
    const uint32_t since = now_ - demanded_;
    for (uint8_t i = 0; i < CHANNELS; ++i) {
      if ((mask & (1u << i)) == 0 || channel_[i].state != State::ARMED) continue;
      if (identity_.role == Role::MOTOR) {
        motor_[i].demand(value[i], since, velocity[i]);
      } else {
        regulator_[i].demand(value[i]);
      }
    }
    // Only a newer echo feeds the watchdog: the same one again does not show that the host still reads.
    if (now_ - echo < now_ - echoed_) {
      echoed_ = echo;
      feed();
    }
    if (mask != 0) demanded_ = now_;
  }
  allow_tick();
  return accepted();
}

Verdict Board::check_clear(uint8_t i) const {
  const bool wire = channel_[i].reason == Reason::SENSOR_WIRE && !regulator_[i].sensor_ok();
  const bool bridge = channel_[i].reason == Reason::BRIDGE && (bridge_faults_ & (1u << i)) != 0;
  const bool cell = channel_[i].reason == Reason::CELL && !feels(i);
  // While a regulator is at rest, every tick updates its fault: here it is that of the newest tick.
  const bool pressure = identity_.role == Role::PRESSURE && regulator_[i].fault() != Reason::NONE;
  return wire || bridge || cell || pressure ? Verdict{Refusal::PERSISTS, i} : accepted();
}

Verdict Board::clear(Reader& in) {
  uint8_t mask = 0;
  Verdict verdict = read_mask(in, mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  block_tick();
  verdict = check_each(mask, &Board::check_clear);
  if (verdict.refusal != Refusal::NONE) {
    allow_tick();
    return verdict;
  }
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0 || channel_[i].state != State::SAFE) continue;
    // Clearing moves nothing: what rests goes on as it rests.
    channel_[i].state = powered(i) ? State::STOPPED : State::READY;
    channel_[i].reason = Reason::NONE;
  }
  allow_tick();
  return accepted();
}

Verdict Board::stop(Reader& in) {
  if (config_.mask == 0) return Verdict{Refusal::NOT_CONFIGURED, 0};
  const uint8_t mask = in.u8();
  const uint8_t rest = in.u8();
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  if (rest > static_cast<uint8_t>(Rest::VENT)) return Verdict{Refusal::BAD_VALUE, rest};
  const Verdict verdict = check_mask(mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  block_tick();
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0) continue;
    Channel& channel = channel_[i];
    // A pulse ends without power: the encoder that would hold is not proven.
    if (channel.state == State::PULSING) {
      pulse_.end();
      channel.state = State::READY;
      continue;
    }
    // A stop takes power away, in every state, and gives none: `hold` neither powers a motor at rest without power nor
    // stops a chamber that vents. A motor without power has nothing to give up, a chamber may be let go faster.
    const bool motor = identity_.role == Role::MOTOR;
    if (!powered(i) && (motor || rest == static_cast<uint8_t>(Rest::HOLD))) continue;
    if (moves(i)) {
      if (motor) motor_[i].hold();
      channel.state = State::STOPPED;
    }
    // The latch of a safe state stays, with its reason.
    channel.rest = rest_of_stop(static_cast<Rest>(rest), identity_.role);
  }
  allow_tick();
  return accepted();
}

// The count jumps to `power_up`, which nothing may follow.
Verdict Board::check_park(uint8_t i) const { return powered(i) ? Verdict{Refusal::ARMED_NOW, i} : accepted(); }

Verdict Board::check_home(uint8_t i) const {
  if (identity_.role != Role::MOTOR || !config_.motor[i].homing) return Verdict{Refusal::NO_HOMING, i};
  if (channel_[i].state == State::SAFE) return Verdict{Refusal::LATCHED, i};
  if (channel_[i].state == State::ARMED) return Verdict{Refusal::ARMED_NOW, i};
  if (pulse_.active()) return Verdict{Refusal::ARMED_NOW, pulse_.channel()};
  if (!fitted(i) || (bridge_faults_ & (1u << i)) != 0) return Verdict{Refusal::PERSISTS, i};
  if (!feels(i)) return Verdict{Refusal::NO_SENSOR, i};
  return accepted();
}

Verdict Board::home(Reader& in) {
  uint8_t mask = 0;
  Verdict verdict = read_mask(in, mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  block_tick();
  verdict = check_each(mask, &Board::check_home);
  if (verdict.refusal != Refusal::NONE) {
    allow_tick();
    return verdict;
  }
  if (!commanded()) feed();
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((mask & (1u << i)) == 0 || channel_[i].state == State::HOMING) continue;
    motor_[i].home();
    channel_[i] = Channel{State::HOMING, Reason::NONE, Safe::HOLD};
  }
  allow_tick();
  return accepted();
}

// `parked` 1: the shafts are at `power_up` now. 0: the host saw a loss of power that the board cannot see, and takes
// the trust in `power_up` back.
Verdict Board::park(Reader& in) {
  Verdict verdict = check_crc(in);
  if (verdict.refusal != Refusal::NONE) return verdict;
  const uint8_t mask = in.u8();
  const uint8_t parked = in.u8();
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  if (parked > 1) return Verdict{Refusal::BAD_VALUE, parked};
  verdict = check_mask(mask);
  if (verdict.refusal != Refusal::NONE) return verdict;
  if (identity_.role != Role::MOTOR) return Verdict{Refusal::WRONG_ROLE, static_cast<uint16_t>(identity_.role)};
  block_tick();
  verdict = check_each(mask, &Board::check_park);
  for (uint8_t i = 0; i < CHANNELS && verdict.refusal == Refusal::NONE; ++i) {
    if ((mask & (1u << i)) == 0) continue;
    if (parked == 1) {
      motor_[i].park();
    } else {
      motor_[i].lose();
    }
  }
  allow_tick();
  return verdict;
}

// Nothing may be under power: a load that another motor holds must not be moved.
Verdict Board::check_pulse(uint8_t i) const {
  const uint8_t powered = under_power();
  if (powered != NO_CHANNEL) return Verdict{Refusal::ARMED_NOW, powered};
  if (pulse_.active()) return Verdict{Refusal::ARMED_NOW, pulse_.channel()};
  if (channel_[i].state == State::SAFE) return Verdict{Refusal::LATCHED, i};
  if (!fitted(i)) return Verdict{Refusal::BAD_CHANNEL, i};
  if ((bridge_faults_ & (1u << i)) != 0) return Verdict{Refusal::PERSISTS, i};
  if (!feels(i)) return Verdict{Refusal::NO_SENSOR, i};
  return accepted();
}

// One open-loop pulse. It needs no feeding, because it ends by itself; an order that waited somewhere, or that came
// before, moves nothing.
Verdict Board::pulse(Reader& in) {
  Verdict verdict = check_crc(in);
  if (verdict.refusal != Refusal::NONE) return verdict;
  const uint32_t echo = in.u32();
  const uint8_t channel = in.u8();
  const int32_t duty = in.i16();
  const bool duty_allowed = duty >= -PULSE_DUTY && duty <= PULSE_DUTY;
  const uint16_t at = static_cast<uint16_t>(in.at());
  const uint8_t ms = in.u8();
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  if (!duty_allowed) return Verdict{Refusal::BAD_VALUE, at};
  if (ms < 1 || ms > PULSE_MS) return Verdict{Refusal::BAD_VALUE, static_cast<uint16_t>(in.at())};
  if (identity_.role != Role::MOTOR) return Verdict{Refusal::WRONG_ROLE, static_cast<uint16_t>(identity_.role)};
  if (channel >= CHANNELS || (config_.mask & (1u << channel)) == 0) return Verdict{Refusal::BAD_CHANNEL, channel};
  block_tick();
  verdict = check_pulse(channel);
  const bool waited = now_ - echo >= static_cast<uint32_t>(config_.watchdog_ms);
  if (verdict.refusal == Refusal::NONE && (waited || now_ - echo >= now_ - pulsed_)) {
    verdict = Verdict{Refusal::STALE, 0};
  }
  if (verdict.refusal == Refusal::NONE) {
    pulsed_ = echo;
    uint8_t reversed = 0;
    for (uint8_t i = 0; i < CHANNELS; ++i) {
      if (config_.motor[i].encoder_reversed) reversed = static_cast<uint8_t>(reversed | (1u << i));
    }
    motor_[channel].arm();
    pulse_.order(channel, duty, ms, reversed);
    channel_[channel] = Channel{State::PULSING, Reason::NONE, rest_of_start(channel)};
  }
  allow_tick();
  return verdict;
}

}  // namespace contid
