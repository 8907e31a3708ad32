// Decodes and range-checks the configuration a host sends.
#include "config.h"

#include "bridge.h"

namespace contid {

namespace {

const uint8_t ENCODER_REVERSED = 1;
const uint8_t MOTOR_REVERSED = 2;
const uint8_t HOMING_GIVEN = 4;
const uint8_t HOME_UP = 8;
const uint8_t TENSION_GIVEN = 16;

// Range of count values: the margin to int32 keeps every difference inside it.
const int32_t COUNT_LIMIT = 1000000000;
const int32_t RATE_LIMIT = 1000000;
const int32_t ACCELERATION_MIN = 16;  // one step of the set-point's fixed point arithmetic
const int32_t GAIN_LIMIT = 1 << 24;
const int32_t PRESSURE_LIMIT = 2000000;
const int32_t CONVERTER_STEPS = 8388607;
const int32_t PRESSURE_STEP = 100;  // neighbouring points of a table at least this far apart [Pa]

// Range checks; keeps the offset of the first value out of range.
class Checker {
 public:
  explicit Checker(Reader& in) : in_(in), bad_at_(0), bad_(false) {}

  int32_t within(int32_t value, int32_t min, int32_t max) {
    if (value >= min && value <= max) return value;
    fail();
    return 0;  // keeps values computed from it before the refusal small
  }
  void require(bool condition) {
    if (!condition) fail();
  }
  bool bad() const { return bad_; }
  uint16_t bad_at() const { return bad_at_; }

 private:
  void fail() {
    if (!bad_) bad_at_ = static_cast<uint16_t>(in_.at());
    bad_ = true;
  }

  Reader& in_;
  uint16_t bad_at_;
  bool bad_;
};

void read_tension(Reader& in, Checker& check, int32_t adc_steps, TensionConfig& t) {
  t.fitted = true;
  t.converter = check.within(in.u8(), 0, 1) != 0;
  t.pull = check.within(in.u8(), 0, 1) != 0 ? 1 : -1;
  const int32_t least = t.converter ? -CONVERTER_STEPS - 1 : 0, most = t.converter ? CONVERTER_STEPS : adc_steps;
  t.raw_low = check.within(in.i32(), least, most);
  t.low = check.within(in.i32(), -TENSION_MOST, TENSION_MOST);
  t.raw_high = check.within(in.i32(), t.raw_low + 64, most);
  t.high = check.within(in.i32(), -TENSION_MOST, TENSION_MOST);
  check.require(t.high != t.low);
  t.valid_low = check.within(in.i32(), least, most);
  t.valid_high = check.within(in.i32(), t.valid_low + 64, most);
  t.silent_ms = check.within(in.u16(), t.converter ? 2 : 0, 1000);
  t.floor = check.within(in.i32(), 20, TENSION_MOST / 4);
  t.ceiling = check.within(in.i32(), 2 * t.floor, TENSION_MOST);
  t.give = check.within(in.i32(), 1, GAIN_LIMIT);
  t.take_up = check.within(in.i32(), 1, COUNT_LIMIT);
  t.slack_ms = check.within(in.u16(), 10, 10000);
  if (check.bad()) t.raw_high = t.raw_low + 64;
}

void read_motor(Reader& in, Checker& check, MotorConfig& m) {
  const uint8_t flags = in.u8();
  check.within(flags, 0, 31);
  m.encoder_reversed = (flags & ENCODER_REVERSED) != 0;
  m.motor_reversed = (flags & MOTOR_REVERSED) != 0;
  m.homing = (flags & HOMING_GIVEN) != 0;
  m.home_up = (flags & HOME_UP) != 0;
  const uint8_t bridge = in.u8();
  check.within(bridge, 0, static_cast<int32_t>(Bridge::DIR_PWM));
  m.bridge = static_cast<Bridge>(bridge);
  check.require(can_start(m.bridge, m.start));
  m.low = check.within(in.i32(), -COUNT_LIMIT, COUNT_LIMIT);
  m.high = check.within(in.i32(), m.low, COUNT_LIMIT);
  m.velocity = check.within(in.i32(), 1, RATE_LIMIT);
  m.acceleration = check.within(in.i32(), ACCELERATION_MIN, 100 * RATE_LIMIT);
  m.kp = check.within(in.i32(), 0, GAIN_LIMIT);
  m.ks = check.within(in.i32(), 0, GAIN_LIMIT);
  m.ki = check.within(in.i32(), 0, GAIN_LIMIT);
  m.kv = check.within(in.i32(), 0, GAIN_LIMIT);
  m.ka = check.within(in.i32(), 0, GAIN_LIMIT);
  m.friction = check.within(in.i16(), 0, DUTY_FULL);
  m.deadband = check.within(in.i32(), 0, COUNT_LIMIT);
  m.stall_duty = check.within(in.i16(), 1, DUTY_FULL);
  m.stall_ms = check.within(in.u16(), 1, 10000);
  m.stall_current_ma = in.u16();
  m.full_scale_ma = in.u16();
  m.follow = check.within(in.i32(), 1, COUNT_LIMIT);
  m.power_up = check.within(in.i32(), -COUNT_LIMIT, COUNT_LIMIT);
  m.home_velocity = check.within(in.i32(), m.homing ? 1 : 0, RATE_LIMIT);
  m.home_duty = check.within(in.i16(), m.homing ? 1 : 0, DUTY_FULL);
  m.home_at = check.within(in.i32(), -COUNT_LIMIT, COUNT_LIMIT);
  m.home_backoff = check.within(in.i32(), 0, COUNT_LIMIT);
  m.home_timeout_ms = check.within(in.u16(), m.homing ? 1 : 0, 60000);
  // A way back shorter than the allowed difference would prove nothing.
  m.home_repeat = check.within(in.i32(), 0, m.homing ? m.home_backoff - 1 : COUNT_LIMIT);
  if ((flags & TENSION_GIVEN) != 0 && !check.bad()) read_tension(in, check, m.adc_steps, m.tension);
}

void read_valves(Reader& in, Checker& check, RegulatorConfig& r) {
  r.outlet_open = check.within(in.u8(), 0, 1) != 0;
  r.valve_ms = check.within(in.u16(), 1, 500);
  r.least_ms = check.within(in.u16(), 1, 500);
  r.band = check.within(in.i32(), 1, PRESSURE_LIMIT);
}

void read_regulator(Reader& in, Checker& check, RegulatorConfig& r) {
  r.ceiling = check.within(in.i32(), PRESSURE_STEP, PRESSURE_LIMIT);
  r.slew = check.within(in.i32(), 1000, 10 * PRESSURE_LIMIT);
  r.vent = check.within(in.i32(), 1000, 10 * PRESSURE_LIMIT);
  r.raw_low = check.within(in.u16(), 0, r.adc_steps);
  r.low = check.within(in.i32(), -PRESSURE_LIMIT, PRESSURE_LIMIT);
  r.raw_high = check.within(in.u16(), r.raw_low + 64, r.adc_steps);
  r.high = check.within(in.i32(), r.low + PRESSURE_STEP, PRESSURE_LIMIT);
  r.wire_raw = check.within(in.u16(), 0, r.adc_steps);
  r.leak = check.within(in.i32(), 1, PRESSURE_LIMIT);
  r.leak_ms = check.within(in.u16(), 1, 10000);
  r.over = check.within(in.i32(), 1, PRESSURE_LIMIT);
  r.over_ms = check.within(in.u16(), 1, 10000);
  r.lag_ms = check.within(in.u16(), 1, 10000);
  r.trim = check.within(in.i32(), 0, PRESSURE_LIMIT);
  r.trim_rate = check.within(in.i32(), 0, 100 * 256);
  r.points = check.within(in.u8(), 0, TABLE_POINTS);
  check.require(r.points != 1);
  if (check.bad()) return;
  if (r.points == 0) {
    read_valves(in, check, r);
    return;
  }
  for (int32_t i = 0; i < r.points; ++i) {
    r.duty[i] = check.within(in.u16(), i == 0 ? 0 : r.duty[i - 1] + 1, DUTY_FULL);
    r.pressure[i] =
        check.within(in.i32(), i == 0 ? -PRESSURE_LIMIT : r.pressure[i - 1] + PRESSURE_STEP, PRESSURE_LIMIT);
  }
  // The table must reach from no pressure to the ceiling: it is never extrapolated.
  check.require(r.pressure[0] <= 0 && r.pressure[r.points - 1] >= r.ceiling);
}

bool fits_role(Safe safe, Role role) {
  // A chamber that holds its pressure without a host is not safe.
  const bool of_motor = safe == Safe::BRAKE || safe == Safe::COAST || safe == Safe::HOLD;
  return of_motor == (role == Role::MOTOR);
}

// A reset leaves no safe state. A chamber that vents ends without pressure, as one whose command is zero at once. A
// motor cannot hold in a reset: a host that chooses hold names what the motor does then. Valves that are shut without
// power keep a chamber's pressure in a reset: their host names hold.
bool same_in_reset(Safe safe, Safe start, bool keeps) {
  switch (safe) {
    case Safe::HOLD:
      return start == Safe::BRAKE || start == Safe::COAST;
    case Safe::VENT:
    case Safe::CLOSE:
      return start == (keeps ? Safe::HOLD : Safe::CLOSE);
    default:
      return safe == start;
  }
}

}  // namespace

Verdict read_config(Reader& in, Role role, int32_t adc_steps, BoardConfig& out) {
  const uint8_t requested = in.u8();
  if (in.ok() && requested != static_cast<uint8_t>(role)) {
    return Verdict{Refusal::WRONG_ROLE, static_cast<uint16_t>(role)};
  }
  Checker check(in);
  out.mask = 0;
  out.watchdog_ms = check.within(in.u16(), 5, 10000);
  const int32_t count = check.within(in.u8(), 1, CHANNELS);
  for (int32_t i = 0; i < count && in.ok() && !check.bad(); ++i) {
    const uint8_t channel = in.u8();
    const uint8_t safe = in.u8();
    const uint8_t start = in.u8();
    if (!in.ok()) break;
    if (channel >= CHANNELS || (out.mask & (1u << channel)) != 0) return Verdict{Refusal::BAD_CHANNEL, channel};
    check.within(safe, 0, static_cast<int32_t>(Safe::CLOSE));
    check.require(fits_role(static_cast<Safe>(safe), role));
    out.mask = static_cast<uint8_t>(out.mask | (1u << channel));
    if (role == Role::MOTOR) {
      out.motor[channel].safe = static_cast<Safe>(safe);
      out.motor[channel].start = static_cast<Safe>(start);
      out.motor[channel].adc_steps = adc_steps;
      read_motor(in, check, out.motor[channel]);
    } else {
      out.regulator[channel].safe = static_cast<Safe>(safe);
      out.regulator[channel].adc_steps = adc_steps;
      read_regulator(in, check, out.regulator[channel]);
    }
    // Whether it keeps its pressure stands behind the values that were read.
    if (role == Role::PRESSURE && (!in.ok() || check.bad())) break;
    const bool keeps = role == Role::PRESSURE && out.regulator[channel].keeps();
    if (!same_in_reset(static_cast<Safe>(safe), static_cast<Safe>(start), keeps))
      return Verdict{Refusal::SAFE_IS_NOT_START, channel};
  }
  if (!in.ok()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  if (check.bad()) return Verdict{Refusal::BAD_VALUE, check.bad_at()};
  if (!in.finished()) return Verdict{Refusal::WRONG_LENGTH, static_cast<uint16_t>(in.at())};
  return accepted();
}

}  // namespace contid
