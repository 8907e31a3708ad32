// One board: states of its channels, watchdog, messages. No heap, no clock of its own, no Arduino.
//
// Two contexts call it. The 1 kHz timer interrupt calls tick(), which alone changes outputs and holds the watchdog.
// loop() calls answer() with frames from the wire; answer() changes state with the tick masked.
#ifndef CONTID_BOARD_H
#define CONTID_BOARD_H

#include "air/regulator.h"
#include "config.h"
#include "motor.h"
#include "pulse.h"
#include "tension/cell_watch.h"

namespace contid {

// Facts about this start of this board, for hello and telemetry.
struct Identity {
  Role role;
  uint16_t boot;                      // counts starts, kept over resets, not over the loss of power
  uint32_t boot_id;                   // random, another one at every start
  uint32_t build_id;                  // of the sources; 0: built by hand
  uint8_t unique_id[UNIQUE_ID_SIZE];  // of the chip
  ResetCause cause;
  uint8_t capabilities[CHANNELS];  // 0: the channel is not fitted
  const char* pins;                // the pin map as text
  uint8_t bridges;                 // kinds of H-bridge it can drive, one bit each
  uint16_t adc_steps, adc_mv;      // full scale of an analogue input; at most 32767 steps
};

struct Outputs {
  Output channel[CHANNELS];
};

class Board {
 public:
  // `mask_tick` and `unmask_tick` disable and enable the timer interrupt; null where it cannot interrupt.
  // `uptime_ms` other than 0 is for tests of the clock's wrap after 49 days.
  void start(const Identity& identity, void (*mask_tick)(), void (*unmask_tick)(), uint32_t uptime_ms = 0);

  // A source of the time since the newest tick [us]; without one the age of telemetry is 0.
  void clock(uint32_t (*since_tick_us)()) { since_tick_us_ = since_tick_us; }

  void tick(const Inputs& in, Outputs& out);

  // Answers one request (header and body, CRC checked and removed). Returns the size of the answer.
  size_t answer(const uint8_t* request, size_t size, uint8_t* out, size_t capacity, PortId port = PortId::NATIVE);

  // A channel that is not fitted, or dropped out, is absent from telemetry and cannot be armed.
  void fit(uint8_t channel, uint8_t capabilities) { identity_.capabilities[channel] = capabilities; }

  // Counters of damaged frames, and of answers dropped because the port had no room.
  void count_bad_frame() { ++bad_frames_; }
  void count_dropped_answer() { ++dropped_; }

  uint32_t uptime_ms() const { return now_; }
  // Channels of the configuration, one bit each.
  uint8_t configured() const { return config_.mask; }
  State state(uint8_t channel) const { return channel_[channel].state; }
  Reason reason(uint8_t channel) const { return channel_[channel].reason; }
  // Time since the last demand that fed the watchdog.
  uint32_t silence_ms() const { return now_ - fed_; }
  Bridge bridge(uint8_t channel) const { return config_.motor[channel].bridge; }
  // Whether a converter of a load cell belongs to the channel.
  bool converts(uint8_t channel) const {
    const TensionConfig& tension = config_.motor[channel].tension;
    return tension.fitted && tension.converter;
  }
  Role role() const { return identity_.role; }

 private:
  struct Channel {
    State state;
    Reason reason;
    Safe rest;  // what it does in READY, STOPPED and SAFE
  };

  Verdict configure(Reader& in);
  Verdict arm(Reader& in);
  Verdict demand(Reader& in);
  Verdict clear(Reader& in);
  Verdict stop(Reader& in);
  Verdict home(Reader& in);
  Verdict park(Reader& in);
  Verdict pulse(Reader& in);
  Verdict check_pulse(uint8_t channel) const;
  Verdict check_crc(Reader& in) const;
  Verdict check_mask(uint8_t mask) const;
  Verdict read_mask(Reader& in, uint8_t& mask) const;
  Verdict check_arm(uint8_t channel) const;
  Verdict check_clear(uint8_t channel) const;
  Verdict check_home(uint8_t channel) const;
  Verdict check_park(uint8_t channel) const;
  // The first refusal of a channel in the mask. Call it with the tick blocked, so that the result stays valid.
  Verdict check_each(uint8_t mask, Verdict (Board::*may)(uint8_t channel) const) const;

  // Whether a channel follows demands or homes.
  bool commanded() const;
  // What it does before a first arm, and after a fault of its own.
  Safe rest_of_start(uint8_t channel) const;
  // Whether a channel follows demands, homes or pulses; or does that, or holds its position or pressure.
  bool moves(uint8_t channel) const;
  bool powered(uint8_t channel) const;
  // The first channel with power; NO_CHANNEL for none.
  uint8_t under_power() const;
  // Whether a channel that holds would be lost by the staged configuration.
  bool staged_loses(uint8_t channel) const;
  // The watchdog is fed: the host read a telemetry and sent a request.
  void feed();

  // Whether a motor counts from an unknown position.
  bool lost(uint8_t channel) const;

  uint32_t flags() const;
  size_t write_hello(uint8_t* out, size_t capacity) const;
  size_t write_telemetry(uint8_t* out, size_t capacity);
  void write_tensions(Writer& to, uint8_t reported) const;
  size_t write_trace(uint8_t* out, size_t capacity);

  bool fitted(uint8_t channel) const { return identity_.capabilities[channel] != 0; }
  // The load cell, if it has one, shows a tension.
  bool feels(uint8_t channel) const { return identity_.role != Role::MOTOR || motor_[channel].feels(); }
  void trip(uint8_t channel, Reason reason);
  Output drive_motor(uint8_t channel);
  void pair_cells();
  Output drive_regulator(uint8_t channel);
  void block_tick() {
    if (mask_tick_ != nullptr) mask_tick_();
  }
  void allow_tick() {
    if (unmask_tick_ != nullptr) unmask_tick_();
  }

  Identity identity_;
  void (*mask_tick_)();
  void (*unmask_tick_)();
  BoardConfig config_, staged_;
  uint16_t config_crc_;
  Channel channel_[CHANNELS];
  Motor motor_[CHANNELS];
  Regulator regulator_[CHANNELS];
  Pulse pulse_;
  CellWatch cells_;
  uint32_t pulsed_;  // the newest telemetry that an order of a pulse echoed
  volatile uint32_t now_;
  uint32_t fed_, demanded_;
  uint32_t echoed_;  // the newest telemetry that the host echoed
  bool stale_;
  uint16_t bad_frames_, dropped_;
  uint16_t trips_;       // channels that the watchdog stopped
  uint32_t longest_ms_;  // longest time between two feeds while a channel was commanded
  bool supply_low_;      // since the last telemetry
  PortId commander_;
  uint32_t (*since_tick_us_)();
  uint8_t bridge_faults_;
};

}  // namespace contid

#endif
