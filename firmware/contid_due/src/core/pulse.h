// One open-loop pulse of a motor, bounded in duty and time, and the trace of what every encoder answered.
//
// The pulse ends in the tick, without a host. The trace goes on behind it: the shaft runs out without drive.
#ifndef CONTID_PULSE_H
#define CONTID_PULSE_H

#include "bytes.h"
#include "inputs.h"

namespace contid {

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

}  // namespace contid

#endif
