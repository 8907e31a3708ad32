// Records a pulse: positions and faults each millisecond, currents each second one, edges of every encoder.
#include "pulse.h"

#include "fixed.h"

namespace contid {

namespace {
const int32_t I16_MOST = 32767;
const uint32_t U16_MOST = 0xFFFF;
uint32_t at_most(uint32_t value, uint32_t max) { return value < max ? value : max; }
}  // namespace

void Pulse::order(uint8_t channel, int32_t duty, uint8_t ms, uint8_t reversed) {
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
Pulse::Moved Pulse::moved(uint8_t i, const Inputs& in) const {
  const bool reversed = (reversed_ & (1u << i)) != 0;
  return Moved{reversed ? minus(0, in.count[i]) : in.count[i], in.edges_a[i], in.edges_b[i], in.missed[i]};
}

void Pulse::tick(uint32_t now, const Inputs& in, int32_t current_ma) {
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
    position_[sample] = static_cast<int16_t>(clamp(moved_[channel_].count, -I16_MOST, I16_MOST));
    if ((in.bridge_faults & (1u << channel_)) != 0) {
      faults_[sample / 8] = static_cast<uint8_t>(faults_[sample / 8] | (1u << (sample % 8)));
    }
    if (sample % CURRENT_EVERY_MS == 0) {
      current_ma_[sample / CURRENT_EVERY_MS] = static_cast<int16_t>(clamp(current_ma, -I16_MOST, I16_MOST));
    }
  }
  // An output that is put out now lasts until the next tick.
  if (at_ >= ms_) driving_ = false;
  if (driving_) ++driven_ms_;
  ++at_;
}

void Pulse::write(Writer& to) const {
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
    to.i16(clamp(m.count, -I16_MOST, I16_MOST));
    to.u16(at_most(m.edges_a, U16_MOST));
    to.u16(at_most(m.edges_b, U16_MOST));
    to.u8(at_most(m.missed, 0xFF));
  }
  for (uint8_t fault : faults_) to.u8(fault);
  for (uint8_t i = 0; i < TRACE_MS / CURRENT_EVERY_MS; ++i) to.i16(i * CURRENT_EVERY_MS < samples ? current_ma_[i] : 0);
  for (uint8_t i = 0; i < TRACE_MS; ++i) to.i16(i < samples ? position_[i] : 0);
}

}  // namespace contid
