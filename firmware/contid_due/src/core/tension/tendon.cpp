// Estimates where a tendon would be at its floor of tension; slack, snap and overload.
#include "tendon.h"

#include "../fixed.h"

namespace contid {

namespace {
const int32_t LAG_MS = 22;
const int32_t SPENT_MS = 20;
const int32_t OVER_MS = 20;
const int32_t SNAP_MS = 2;     // ticks that show it
const uint32_t CONVERTED = 2;  // readings of a converter in the time of a snap
const int64_t FAR_Q16 = static_cast<int64_t>(1) << 40;
}  // namespace

void Tendon::configure(const TensionConfig& config, int32_t position) {
  config_ = &config;
  give_q16_ = static_cast<int64_t>(config.give) * 256 / 1000;
  cell_.configure(config);
  arm(position);
}

void Tendon::arm(int32_t position) {
  cell_.place(position);
  known_ = false;
  kept_ = 0;
  slack_ticks_ = 0;
  over_ticks_ = 0;
  spent_ticks_ = 0;
  snap_ticks_ = 0;
  fault_ = Reason::NONE;
}

int32_t Tendon::way() const {
  const int64_t way = (static_cast<int64_t>(config_->floor) * give_q16_) >> 16;
  return static_cast<int32_t>(clamp64(way, 8, 1 << 24));
}

void Tendon::sense(const CellReading& reading, int32_t position) {
  position_ = position;
  cell_.sense(reading, position);
  follow(position);
}

// The fence: where the shaft is, and the way that is left to the floor.
void Tendon::follow(int32_t position) {
  at_ += rate_;
  if (!cell_.fresh() || !cell_.ok()) return;
  const int64_t missing = static_cast<int64_t>(config_->floor) + MARGIN - cell_.tension();
  const int64_t seen =
      static_cast<int64_t>(position) * 65536 + config_->pull * clamp64(missing * give_q16_, -FAR_Q16, FAR_Q16);
  const int64_t off = seen - at_;
  if (!known_) {
    at_ = seen;
    rate_ = 0;
    known_ = true;
  } else if (config_->converter || cell_.tension() < config_->floor / 4) {
    // What is slack does not show where the body goes, and readings of a converter come too late for a speed.
    at_ += off / 2;
    rate_ = 0;
  } else {
    at_ += off / 4;
    rate_ += off / 32;
    // A shaft that pays out moves the estimate with it: only the way of a body that gives in is its own.
    if (rate_ * config_->pull < 0) rate_ = 0;
  }
}

Fence Tendon::fence(int64_t speed) const {
  // The shaft is late by LAG_MS behind a set-point that pays out, or a body that gives in.
  const int64_t paying = -config_->pull * speed, giving = config_->pull * rate_;
  const int64_t late = LAG_MS * (paying > giving ? paying : giving);
  const int64_t at = at_ + config_->pull * (late > 0 ? late : 0);
  return Fence{config_->pull, at, rate_, static_cast<int64_t>(config_->take_up) * 65536, known_ && cell_.ok()};
}

// The tension fell from the floor to nothing faster than the shaft paid out.
bool Tendon::snapped(int32_t position) {
  if (!cell_.fresh()) return snap_ticks_ > 0;
  const uint32_t span = config_->converter ? CONVERTED : HISTORY - 1;
  const int32_t tension = cell_.tension();
  bool fell = false;
  if (kept_ >= span) {
    const uint32_t then = (newest_ + HISTORY - span + 1) % HISTORY;
    const int64_t paid = -static_cast<int64_t>(config_->pull) * minus(position, place_[then]);
    // 1000 / give mN per count, times 256: of the stiffest tendon, so the shaft explains no more.
    const int64_t explained = paid > 0 ? paid * 256 * 1000 / config_->give : 0;
    fell = tension < config_->floor / 4 && past_[then] - tension > config_->floor / 2 + explained;
  }
  newest_ = (newest_ + 1) % HISTORY;
  past_[newest_] = tension;
  place_[newest_] = position;
  if (kept_ < HISTORY) ++kept_;
  return fell;
}

void Tendon::watch(bool spent) {
  const Reason cell = cell_.fault();
  if (cell != Reason::NONE) {
    fault_ = cell;
    return;
  }
  if (!cell_.ok()) return;
  const int32_t tension = cell_.tension();
  const bool slack = tension < config_->floor / 2;
  snap_ticks_ = snapped(position_) ? snap_ticks_ + 1 : 0;
  slack_ticks_ = slack ? slack_ticks_ + 1 : 0;
  spent_ticks_ = slack && spent ? spent_ticks_ + 1 : 0;
  over_ticks_ = tension > config_->ceiling ? over_ticks_ + 1 : 0;
  if (over_ticks_ >= OVER_MS) {
    fault_ = Reason::OVER_TENSION;
  } else if (snap_ticks_ >= SNAP_MS || (snap_ticks_ > 0 && config_->converter)) {
    fault_ = Reason::SNAP;
  } else if (slack_ticks_ >= config_->slack_ms || spent_ticks_ >= SPENT_MS) {
    fault_ = Reason::SLACK;
  }
}

}  // namespace contid
