// Pulses of two on/off valves.
//
// A pulse ends after its width, or earlier, when the reading at its present rate would reach the set-point by the time
// that the valve is shut. Then both valves are shut until the reading has settled, and its change is the gain of that
// direction. A next pulse aims at half of the way, and is at most twice as long as the one before: the delays of the
// valves and the size of the chamber need not be known.
#include "valve_pair.h"

#include "../fixed.h"

namespace contid {

namespace {
const int32_t READING_MS = 8;  // age of the averaged reading and of its rate, about
const int32_t SETTLE_MS = 26;  // window of both
const int32_t LONGEST_MS = 500;
const int32_t Q4 = 16;
const int32_t INLET = 1, OUTLET = 2;  // bits of the lines that have power
}  // namespace

void ValvePair::configure(const RegulatorConfig& config) {
  config_ = &config;
  forget();
}

void ValvePair::forget() {
  in_ = Flow{0, 0, 0, 0};
  out_ = in_;
  flowing_ = Flowing::NONE;
  measured_ = Flowing::NONE;
  ticks_ = 0;
  width_ = 0;
  wait_ = 0;
}

Output ValvePair::follow(int32_t set, int32_t pressure, int32_t rate) {
  const int32_t off = set - pressure;
  if (flowing_ != Flowing::NONE) {
    ++ticks_;
    const int64_t ahead = static_cast<int64_t>(rate) * (config_->valve_ms + READING_MS) / 1000;
    const int64_t left = flowing_ == Flowing::IN ? off - ahead : ahead - off;
    if (ticks_ >= width_ || (left <= 0 && ticks_ >= config_->least_ms)) {
      measured_ = flowing_;
      flowing_ = Flowing::NONE;
      wait_ = config_->valve_ms + SETTLE_MS;
    }
    return lines();
  }
  if (wait_ > 0) {
    --wait_;
    return lines();
  }
  if (measured_ != Flowing::NONE) settle(pressure);
  if (magnitude(off) > config_->band) begin(off, pressure);
  return lines();
}

Output ValvePair::empty() {
  forget();
  flowing_ = Flowing::OUT;
  const Output out = lines();
  flowing_ = Flowing::NONE;
  return out;
}

// The newest pulse has come to rest.
void ValvePair::settle(int32_t pressure) {
  Flow& flow = measured_ == Flowing::IN ? in_ : out_;
  const int32_t change = clamp(measured_ == Flowing::IN ? pressure - from_ : from_ - pressure, 0, 1 << 24);
  const int32_t gain = change * Q4 / ticks_;
  const int32_t kept = flow.gain_q4 - flow.gain_q4 / 8;
  flow.gain_q4 = gain > kept ? gain : kept;
  if (change > config_->band / 2 && (flow.least == 0 || change < flow.least)) flow.least = change;
  flow.last_ms = ticks_;
  flow.at = pressure;
  measured_ = Flowing::NONE;
}

void ValvePair::begin(int32_t off, int32_t pressure) {
  Flow& flow = off > 0 ? in_ : out_;
  // Farther from the end of its range than when it was measured, the flow is stronger than then.
  const int32_t stronger = off > 0 ? flow.at - pressure : pressure - flow.at;
  if (stronger > 4 * config_->band) flow = Flow{0, 0, 0, 0};
  // A valve that opens at all stays open for the time that it takes to shut: less than its least change is not to be
  // had.
  if (flow.least > magnitude(off)) return;
  width_ = width(flow, magnitude(off));
  flowing_ = off > 0 ? Flowing::IN : Flowing::OUT;
  ticks_ = 0;
  from_ = pressure;
}

// Length of the next pulse [ms].
int32_t ValvePair::width(const Flow& flow, int32_t off) const {
  if (flow.last_ms == 0) return config_->least_ms;
  int32_t length = LONGEST_MS;
  if (flow.gain_q4 > 0) {
    length = static_cast<int32_t>(clamp64(static_cast<int64_t>(off) * Q4 / 2 / flow.gain_q4, 0, LONGEST_MS));
  }
  const int32_t most = 2 * flow.last_ms > LONGEST_MS ? LONGEST_MS : 2 * flow.last_ms;
  return clamp(length, config_->least_ms, most);
}

Output ValvePair::lines() const {
  const bool in = flowing_ == Flowing::IN, out = flowing_ == Flowing::OUT;
  const bool outlet = config_->outlet_open ? !out : out;
  return Output{Drive::VALVES, (in ? INLET : 0) | (outlet ? OUTLET : 0)};
}

}  // namespace contid
