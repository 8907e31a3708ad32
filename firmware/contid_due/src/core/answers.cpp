// Dispatches a request to its handler and writes the answer.
#include "board.h"
#include "fixed.h"

namespace contid {

namespace {

const uint32_t U16_MAX = 0xFFFF;

uint32_t at_most(uint32_t value, uint32_t max) { return value < max ? value : max; }

// Requests of the host that moves the robot; hello and stop are for everybody.
bool commands(uint8_t type) { return type != HELLO && type != STOP; }

uint8_t answer_type(uint8_t type) {
  switch (type) {
    case HELLO:
      return HELLO_ANSWER;
    case CONFIGURE:
      return CONFIGURED;
    case TRACE:
      return PULSED;
    default:
      return TELEMETRY;
  }
}

}  // namespace

size_t Board::answer(const uint8_t* request, size_t size, uint8_t* out, size_t capacity, PortId port) {
  Reader in(request, size);
  const uint8_t version = in.u8();
  const uint8_t type = in.u8();
  const uint8_t sequence = in.u8();
  if (!in.ok()) {
    count_bad_frame();
    return 0;
  }
  const size_t body = in.left();
  Verdict verdict = accepted();
  if (version != PROTOCOL_VERSION) {
    verdict = Verdict{Refusal::WRONG_VERSION, PROTOCOL_VERSION};
  } else if (commands(type) && port != commander_ && (commanded() || pulse_.active())) {
    verdict = Verdict{Refusal::OTHER_PORT, static_cast<uint16_t>(commander_)};
  } else {
    if (commands(type)) commander_ = port;
    switch (type) {
      case HELLO:
        if (body != 0) verdict = Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(body)};
        break;
      case CONFIGURE:
        verdict = configure(in);
        break;
      case ARM:
        verdict = arm(in);
        break;
      case DEMAND:
        verdict = demand(in);
        break;
      case CLEAR:
        verdict = clear(in);
        break;
      case STOP:
        verdict = stop(in);
        break;
      case HOME:
        verdict = home(in);
        break;
      case PARK:
        verdict = park(in);
        break;
      case PULSE:
        verdict = pulse(in);
        break;
      case TRACE:
        verdict = check_crc(in);
        if (verdict.refusal == Refusal::NONE && !in.finished()) {
          verdict = Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
        }
        break;
      default:
        verdict = Verdict{Refusal::UNKNOWN_MESSAGE, type};
        break;
    }
  }

  Writer head(out, capacity);
  head.u8(PROTOCOL_VERSION);
  if (verdict.refusal != Refusal::NONE) {
    head.u8(REFUSED);
    head.u8(sequence);
    head.u8(type);
    head.u8(static_cast<uint8_t>(verdict.refusal));
    head.u16(verdict.detail);
    return head.size();
  }
  head.u8(answer_type(type));
  head.u8(sequence);
  uint8_t* rest = out + head.size();
  const size_t room = capacity - head.size();
  if (type == HELLO) return head.size() + write_hello(rest, room);
  if (type == CONFIGURE) {
    head.u16(config_crc_);
    return head.size();
  }
  if (type == TRACE) return head.size() + write_trace(rest, room);
  return head.size() + write_telemetry(rest, room);
}

size_t Board::write_trace(uint8_t* out, size_t capacity) {
  Writer to(out, capacity);
  block_tick();
  pulse_.write(to);
  allow_tick();
  return to.size();
}

uint32_t Board::flags() const {
  uint32_t bits = config_.mask != 0 ? BOARD_CONFIGURED : 0u;
  if (stale_) bits |= BOARD_DEMAND_STALE;
  if (supply_low_) bits |= BOARD_SUPPLY_LOW;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const bool used = config_.mask == 0 || (config_.mask & (1u << i)) != 0;
    if (used && lost(i)) bits |= BOARD_POSITION_LOST;
  }
  return bits;
}

size_t Board::write_hello(uint8_t* out, size_t capacity) const {
  Writer to(out, capacity);
  to.u8(static_cast<uint8_t>(identity_.role));
  to.u8(CHANNELS);
  to.u8(FIRMWARE_MAJOR);
  to.u8(FIRMWARE_MINOR);
  to.u8(FIRMWARE_PATCH);
  to.u32(identity_.build_id);
  for (uint8_t byte : identity_.unique_id) to.u8(byte);
  to.u16(identity_.boot);
  to.u32(identity_.boot_id);
  to.u32(now_);
  to.u8(static_cast<uint8_t>(identity_.cause));
  to.u8(flags());
  to.u16(config_crc_);
  for (uint8_t i = 0; i < CHANNELS; ++i) to.u8(identity_.capabilities[i]);
  to.u8(identity_.bridges);
  to.u16(identity_.adc_steps);
  to.u16(identity_.adc_mv);
  for (const char* c = identity_.pins; c != nullptr && *c != '\0'; ++c) to.u8(static_cast<uint8_t>(*c));
  return to.size();
}

size_t Board::write_telemetry(uint8_t* out, size_t capacity) {
  Writer to(out, capacity);
  // All numbers of one answer are of one tick.
  block_tick();
  to.u32(now_);
  to.u16(since_tick_us_ != nullptr ? at_most(since_tick_us_(), U16_MAX) : 0u);
  to.u32(identity_.boot_id);
  to.u8(static_cast<uint8_t>(identity_.cause));
  to.u16(config_crc_);
  to.u8(flags());
  supply_low_ = false;
  to.u16(bad_frames_);
  to.u16(dropped_);
  to.u16(trips_);
  to.u16(at_most(longest_ms_, U16_MAX));
  uint8_t reported = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((config_.mask & (1u << i)) != 0 && fitted(i)) reported = static_cast<uint8_t>(reported | (1u << i));
  }
  to.u8(reported);
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((reported & (1u << i)) == 0) continue;
    const Motor& m = motor_[i];
    const Regulator& r = regulator_[i];
    const bool motor = identity_.role == Role::MOTOR;
    uint32_t state = static_cast<uint32_t>(channel_[i].state);
    if (motor ? m.limited() : r.limited()) state |= CHANNEL_LIMITED;
    if (motor && m.homed()) state |= CHANNEL_HOMED;
    if (motor || r.sensor_ok()) state |= CHANNEL_SENSOR_OK;
    if (lost(i)) state |= CHANNEL_POSITION_LOST;
    to.u8(state);
    to.u8(static_cast<uint32_t>(channel_[i].reason));
    to.i32(motor ? m.position() : r.pressure());
    to.i32(motor ? m.velocity() : r.rate());
    to.i16(motor ? m.duty() : r.duty());
    to.i16(motor ? clamp(m.current_ma(), -32767, 32767) : r.raw());
    to.u8(motor ? at_most(m.missed_edges(), 0xFF) : 0u);
  }
  write_tensions(to, reported);
  allow_tick();
  return to.size();
}

// Behind the channels, of a configuration with load cells only: a host without them never reads it.
void Board::write_tensions(Writer& to, uint8_t reported) const {
  uint8_t cells = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const bool cell = (reported & (1u << i)) != 0 && motor_[i].tendon() != nullptr;
    if (cell && identity_.role == Role::MOTOR) cells = static_cast<uint8_t>(cells | (1u << i));
  }
  if (cells == 0) return;
  to.u8(cells);
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if ((cells & (1u << i)) != 0) to.i32(feels(i) ? motor_[i].tendon()->tension() : NO_TENSION);
  }
}

}  // namespace contid
