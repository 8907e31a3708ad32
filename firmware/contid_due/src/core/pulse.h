// One open-loop pulse of a motor, bounded in duty and time, and the trace of what every encoder answered.
//
// The pulse ends in the tick, without a host. The trace goes on behind it: the shaft runs out without drive.
#ifndef CONTID_PULSE_H
#define CONTID_PULSE_H

#include "bytes.h"
#include "fixed.h"
#include "protocol.h"

namespace contid {

// What the hardware layer reads for one tick.
struct Inputs {
  int32_t count[CHANNELS];
  int32_t analog[CHANNELS];   // 12 bit
  uint8_t bridge_faults;      // one bit per channel whose H-bridge reports a fault
  uint32_t missed[CHANNELS];  // encoder edges missed since the start
  // Level changes of the tracks since the start: every one of an edge decoder; of a hardware decoder those that
  // samples of 1 ms show, which are fewer.
  uint32_t edges_a[CHANNELS], edges_b[CHANNELS];
  int32_t cell_analog[CHANNELS];  // of amplifiers of load cells
  int32_t cell_steps[CHANNELS];   // the newest of converters, 24 bit and signed
  uint8_t cell_fresh;             // one bit per converter that finished since the last tick
  bool supply_low;                // the 3.3 V were below their threshold since the last tick
};

class Pulse {
 public:
  // No pulse yet.
  void reset() { channel_ = NO_CHANNEL; }
  // The drive starts with the next tick. `reversed` has a bit per channel whose encoder the configuration reverses.
  void order(uint8_t channel, int32_t duty, uint8_t ms, uint8_t reversed);
  // Records a tick, before the drive of this tick is put out.
  void tick(uint32_t now, const Inputs& in, int32_t current_ma);
  // No drive from now on; the trace goes on.
  void end() { driving_ = false; }

  // The drive or its trace is under way.
  bool active() const { return channel_ != NO_CHANNEL && at_ <= TRACE_MS; }
  bool drives() const { return driving_; }
  uint8_t channel() const { return channel_; }
  int32_t duty() const { return duty_; }

  void write(Writer& to) const;

 private:
  struct Moved {
    int32_t count;
    uint32_t edges_a, edges_b, missed;
  };
  Moved moved(uint8_t channel, const Inputs& in) const;

  uint8_t channel_, ms_, driven_ms_, reversed_;
  int32_t duty_;
  uint32_t start_ms_;
  uint8_t at_;  // ticks since the start; 0 before the first
  bool driving_;
  Moved start_[CHANNELS], moved_[CHANNELS];
  uint8_t faults_[TRACE_MS / 8];
  int16_t position_[TRACE_MS];
  int16_t current_ma_[TRACE_MS / CURRENT_EVERY_MS];
};

const int32_t PULSE_I16_MOST = 32767;
const uint32_t PULSE_U16_MOST = 0xFFFF;

inline uint32_t pulse_at_most(uint32_t value, uint32_t max) { return value < max ? value : max; }

inline void Pulse::order(uint8_t channel, int32_t duty, uint8_t ms, uint8_t reversed) {
  channel_ = channel;
  duty_ = clamp(duty, -PULSE_DUTY, PULSE_DUTY);
  ms_ = ms < PULSE_MS ? ms : PULSE_MS;
  reversed_ = reversed;
  driven_ms_ = 0;
  start_ms_ = 0;
  at_ = 0;
  driving_ = true;
  for (uint8_t& fault : faults_) fault = 0;
}

// Of the inputs, in the sense of the configuration.
inline Pulse::Moved Pulse::moved(uint8_t i, const Inputs& in) const {
  const bool reversed = (reversed_ & (1u << i)) != 0;
  return Moved{reversed ? minus(0, in.count[i]) : in.count[i], in.edges_a[i], in.edges_b[i], in.missed[i]};
}

inline void Pulse::tick(uint32_t now, const Inputs& in, int32_t current_ma) {
  if (!active()) return;
  if (at_ == 0) {
    start_ms_ = now;
    for (uint8_t i = 0; i < CHANNELS; ++i) {
      start_[i] = moved(i, in);
      moved_[i] = Moved{0, 0, 0, 0};
    }
  } else {
    const uint8_t sample = static_cast<uint8_t>(at_ - 1);
    for (uint8_t i = 0; i < CHANNELS; ++i) {
      const Moved now_at = moved(i, in);
      moved_[i] = Moved{minus(now_at.count, start_[i].count), now_at.edges_a - start_[i].edges_a,
                        now_at.edges_b - start_[i].edges_b, now_at.missed - start_[i].missed};
    }
    position_[sample] = static_cast<int16_t>(clamp(moved_[channel_].count, -PULSE_I16_MOST, PULSE_I16_MOST));
    if ((in.bridge_faults & (1u << channel_)) != 0) {
      faults_[sample / 8] = static_cast<uint8_t>(faults_[sample / 8] | (1u << (sample % 8)));
    }
    if (sample % CURRENT_EVERY_MS == 0) {
      current_ma_[sample / CURRENT_EVERY_MS] = static_cast<int16_t>(clamp(current_ma, -PULSE_I16_MOST, PULSE_I16_MOST));
    }
  }
  // An output that is put out now lasts until the next tick.
  if (at_ >= ms_) driving_ = false;
  if (driving_) ++driven_ms_;
  ++at_;
}

inline void Pulse::write(Writer& to) const {
  const uint8_t samples = channel_ == NO_CHANNEL || at_ == 0 ? static_cast<uint8_t>(0) : static_cast<uint8_t>(at_ - 1);
  to.u8(channel_);
  if (channel_ == NO_CHANNEL) return;
  to.u32(start_ms_);
  to.i16(duty_);
  to.u8(ms_);
  to.u8(driven_ms_);
  to.u8(samples);
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const Moved none = Moved{0, 0, 0, 0};
    const Moved& m = samples == 0 ? none : moved_[i];
    to.i16(clamp(m.count, -PULSE_I16_MOST, PULSE_I16_MOST));
    to.u16(pulse_at_most(m.edges_a, PULSE_U16_MOST));
    to.u16(pulse_at_most(m.edges_b, PULSE_U16_MOST));
    to.u8(pulse_at_most(m.missed, 0xFF));
  }
  for (uint8_t fault : faults_) to.u8(fault);
  for (uint8_t i = 0; i < TRACE_MS / CURRENT_EVERY_MS; ++i) to.i16(i * CURRENT_EVERY_MS < samples ? current_ma_[i] : 0);
  for (uint8_t i = 0; i < TRACE_MS; ++i) to.i16(i < samples ? position_[i] : 0);
}

}  // namespace contid

#endif
