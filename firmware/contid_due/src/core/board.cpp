// The board in its timer interrupt: watchdog, control laws, safe states. Requests: orders.cpp; answers: answers.cpp.
#include "board.h"

#include <string.h>

namespace contid {

namespace {
Drive unpowered(Safe rest) { return rest == Safe::COAST ? Drive::COAST : Drive::BRAKE; }
}  // namespace

void Board::start(const Identity& identity, void (*mask_tick)(), void (*unmask_tick)(), uint32_t uptime_ms) {
  // A board is plain data: all zero is its state after a reset.
  memset(static_cast<void*>(this), 0, sizeof(*this));
  identity_ = identity;
  mask_tick_ = mask_tick;
  unmask_tick_ = unmask_tick;
  now_ = uptime_ms;
  fed_ = uptime_ms;
  echoed_ = uptime_ms;
  demanded_ = uptime_ms;
  pulsed_ = uptime_ms;
  pulse_.reset();
  // Only the loss of power is the moment at which a shaft is parked; any other start finds it anywhere.
  if (identity.cause == ResetCause::POWER_UP) return;
  for (uint8_t i = 0; i < CHANNELS; ++i) motor_[i].lose();
}

void Board::tick(const Inputs& in, Outputs& out) {
  now_ = now_ + 1;
  bridge_faults_ = in.bridge_faults;
  if (in.supply_low) supply_low_ = true;
  const bool motors = identity_.role == Role::MOTOR;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if (motors) {
      const bool fresh = (in.cell_fresh & (1u << i)) != 0;
      motor_[i].sense(in.count[i], in.analog[i], in.missed[i], CellReading{in.cell_analog[i], in.cell_steps[i], fresh});
    } else {
      regulator_[i].sense(in.analog[i]);
    }
    if (i == pulse_.channel()) pulse_.tick(now_, in, motor_[i].current_ma());
    Channel& channel = channel_[i];
    if (channel.state == State::OFF) {
      out.channel[i] = Output{Drive::OFF, 0};
      continue;
    }
    const bool commanded = channel.state == State::ARMED || channel.state == State::HOMING;
    if (commanded && now_ - fed_ >= static_cast<uint32_t>(config_.watchdog_ms)) trip(i, Reason::WATCHDOG);
    out.channel[i] = motors ? drive_motor(i) : drive_regulator(i);
  }
  if (motors) pair_cells();
}

// Looks for a cell that answers another tendon.
void Board::pair_cells() {
  Pulled pulled[CHANNELS];
  bool any = false;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const Motor& motor = motor_[i];
    const Tendon* tendon = motor.tendon();
    pulled[i] = Pulled{false, motor.position(), 0, 0, 0, 0};
    if (tendon == nullptr || !tendon->ok()) continue;
    const TensionConfig& config = tendon->config();
    pulled[i] = Pulled{true, motor.position(), tendon->tension(), config.pull, tendon->way(), config.floor};
    any = true;
  }
  if (!any) return;
  const uint8_t wrong = cells_.tick(pulled);
  if (wrong != NO_CHANNEL) motor_[wrong].disown();
}

bool Board::lost(uint8_t i) const { return identity_.role == Role::MOTOR && motor_[i].lost(); }

bool Board::commanded() const {
  for (const Channel& channel : channel_) {
    if (channel.state == State::ARMED || channel.state == State::HOMING) return true;
  }
  return false;
}

bool Board::moves(uint8_t i) const {
  const State state = channel_[i].state;
  return state == State::ARMED || state == State::HOMING || state == State::PULSING;
}

bool Board::powered(uint8_t i) const {
  const State state = channel_[i].state;
  return moves(i) || ((state == State::STOPPED || state == State::SAFE) && channel_[i].rest == Safe::HOLD);
}

Safe Board::rest_of_start(uint8_t i) const {
  return identity_.role == Role::MOTOR ? config_.motor[i].start : config_.regulator[i].safe;
}

uint8_t Board::under_power() const {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if (powered(i)) return i;
  }
  return NO_CHANNEL;
}

void Board::feed() {
  const uint32_t gap = now_ - fed_;
  if (commanded() && gap > longest_ms_) longest_ms_ = gap;
  fed_ = now_;
}

void Board::trip(uint8_t i, Reason reason) {
  if (reason == Reason::WATCHDOG && trips_ < UINT16_MAX) {
    trips_ = static_cast<uint16_t>(trips_ + 1);
    if (now_ - fed_ > longest_ms_) longest_ms_ = now_ - fed_;
  }
  const bool motor = identity_.role == Role::MOTOR;
  // Holding needs a working encoder and shaft: after a fault of theirs the drive is off.
  const bool holds = motor && reason == Reason::WATCHDOG && config_.motor[i].safe == Safe::HOLD;
  channel_[i] = Channel{State::SAFE, reason, holds ? Safe::HOLD : rest_of_start(i)};
  if (motor) motor_[i].hold();
}

Output Board::drive_motor(uint8_t i) {
  Channel& channel = channel_[i];
  Motor& motor = motor_[i];
  const bool drives = channel.state == State::PULSING ? pulse_.drives() : powered(i);
  Output out = Output{Drive::COAST, 0};
  if (!drives) {
    out = motor.rest(unpowered(channel.rest));
    if (channel.state == State::PULSING && !pulse_.active()) channel.state = State::READY;
  } else if (channel.state == State::PULSING) {
    out = motor.pulse(pulse_.duty());
  } else if (channel.state == State::HOMING) {
    out = motor.search();
    if (motor.search_done()) {
      channel.state = State::STOPPED;
      motor.hold();
    }
  } else {
    out = motor.follow();
  }
  const bool bridge = (bridge_faults_ & (1u << i)) != 0;
  if (drives && (bridge || motor.fault() != Reason::NONE)) {
    if (i == pulse_.channel()) pulse_.end();
    trip(i, bridge ? Reason::BRIDGE : motor.fault());
    return motor.rest(unpowered(channel.rest));
  }
  return out;
}

Output Board::drive_regulator(uint8_t i) {
  Regulator& regulator = regulator_[i];
  if (powered(i)) {
    const Output out = channel_[i].state == State::ARMED ? regulator.follow() : regulator.hold();
    if (regulator.fault() == Reason::NONE) return out;
    trip(i, regulator.fault());
  }
  const Output out = channel_[i].rest == Safe::CLOSE ? regulator.close() : regulator.vent();
  // At rest a fault changes no output, but the channel cannot be armed before it is cleared.
  if (regulator.fault() != Reason::NONE) trip(i, regulator.fault());
  return out;
}

}  // namespace contid
