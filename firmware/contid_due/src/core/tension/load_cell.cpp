// Reads a load cell: scale, range, silence, and readings that stand still while the shaft moves.
#include "load_cell.h"

#include "../fixed.h"

namespace contid {

namespace {
const int32_t BAD_MS = 10;          // longer than a disturbance of the wire
const int32_t FROZEN_MS = 100;      // readings of an analogue pin that are alike, while the shaft moves
const int32_t FROZEN_READINGS = 4;  // the same of a converter
const int32_t STILL_READINGS = 40;  // of a converter at rest: its last bits always move
const int32_t LEAST_WAY = 8;        // counts
}  // namespace

void LoadCell::configure(const TensionConfig& config) {
  config_ = &config;
  steps_ = config.converter ? 1 : static_cast<int32_t>(WINDOW);
  const int64_t rise = (static_cast<int64_t>(config.high) - config.low) * (1 << 20);
  slope_q20_ = rise / ((static_cast<int64_t>(config.raw_high) - config.raw_low) * steps_);
  primed_ = false;
  bad_ticks_ = 0;
  silent_ticks_ = 0;
  same_ = 0;
  frozen_ = false;
}

void LoadCell::sense(const CellReading& reading, int32_t position) {
  fresh_ = reading.fresh || !config_->converter;
  if (!fresh_) {
    if (silent_ticks_ < config_->silent_ms + BAD_MS) ++silent_ticks_;
    if (silent_ticks_ > config_->silent_ms && bad_ticks_ < BAD_MS) ++bad_ticks_;
    return;
  }
  silent_ticks_ = 0;
  const int32_t raw = config_->converter ? reading.converted : reading.analog;
  const bool bad = raw < config_->valid_low || raw > config_->valid_high;
  // A second reading of a converter out of range is no disturbance.
  const int32_t step = config_->converter ? BAD_MS / 2 : 1;
  bad_ticks_ = bad ? clamp(bad_ticks_ + step, 0, BAD_MS) : 0;
  if (bad) return;
  if (!primed_) {
    for (int32_t& each : readings_) each = raw;
    sum_ = raw * steps_;
    raw_ = plus(raw, 1);
    primed_ = true;
  }
  if (config_->converter) {
    sum_ = raw;
  } else {
    sum_ += raw - readings_[at_];
    readings_[at_] = raw;
    at_ = (at_ + 1) % WINDOW;
  }
  const int64_t above = static_cast<int64_t>(sum_) - static_cast<int64_t>(config_->raw_low) * steps_;
  tension_ = static_cast<int32_t>(clamp64(config_->low + ((above * slope_q20_) >> 20), -TENSION_MOST, TENSION_MOST));
  frozen_ = frozen(raw, position);
}

// Whether the readings are alike to the last bit although the shaft goes the way that changes the tension by twice the
// floor; of a converter also without a way.
bool LoadCell::frozen(int32_t raw, int32_t position) {
  if (raw != raw_) {
    raw_ = raw;
    same_ = 0;
    least_ = position;
    most_ = position;
    return false;
  }
  if (same_ < FROZEN_MS) ++same_;
  if (minus(position, least_) < 0) least_ = position;
  if (minus(position, most_) > 0) most_ = position;
  const int64_t way = static_cast<int64_t>(config_->floor) * config_->give / (1000 / 2 * 256);
  const bool went = minus(most_, least_) >= (way > LEAST_WAY ? way : LEAST_WAY);
  if (config_->converter) return same_ >= STILL_READINGS || (went && same_ >= FROZEN_READINGS);
  return went && same_ >= FROZEN_MS;
}

Reason LoadCell::fault() const {
  if (bad_ticks_ >= BAD_MS || (!primed_ && silent_ticks_ > config_->silent_ms)) return Reason::CELL;
  return frozen_ ? Reason::CELL_FROZEN : Reason::NONE;
}

}  // namespace contid
