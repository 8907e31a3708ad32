// Sums the drive that the count does not answer.
#include "encoder_watch.h"

#include "fixed.h"

namespace contid {

namespace {
const int32_t ADVANCE = 2;      // counts; one open track never shows more than one
const int32_t FASTEST_MS = 10;  // least time constant of a shaft
// Way of the slowest shaft at which the count must have advanced, times its inertia: 4 counts, four times the file's
// time constant, 80 % of its speed; in duty ticks squared per ka.
const int32_t OWED_COUNTS = 4;
const int32_t OWED_PER_KA = 305;
const int32_t OWED_MOST = 1000000000;
// Momentum of the slowest shaft per count in eight ticks and ka, in duty ticks, times 8.
const int32_t MOMENTUM_PER_KA_8 = 61;
const int32_t INERTIA_MOST = 1 << 20;
const int32_t JITTER = 2;  // of the counts in eight ticks
const int32_t MOVED_MOST = 240;
}  // namespace

void EncoderWatch::configure(const MotorConfig& config) {
  kv_ = config.kv;
  // ka / kv is the time constant.
  const int64_t fastest = static_cast<int64_t>(config.kv) * 256 * FASTEST_MS / static_cast<int32_t>(TICK_HZ);
  inertia_ = static_cast<int32_t>(clamp64(config.ka > fastest ? config.ka : fastest, 1, INERTIA_MOST));
  limit_ = OWED_PER_KA * inertia_;
  play_ = static_cast<int32_t>(clamp64(static_cast<int64_t>(limit_) * config.deadband / OWED_COUNTS, 0, OWED_MOST));
  base_ = config.stall_duty;
}

void EncoderWatch::mark(int32_t position) {
  mark_ = position;
  last_ = position;
  along_ = 0;
  idle_ = 0;
  edges_ = 0;
  backward_ = false;
  momentum_ = 0;
  owed_ = 0;
}

void EncoderWatch::rest(int32_t position) {
  mark(position);
  owed_ = -play_;
  advanced_ = true;
}

void EncoderWatch::start(int32_t position, int32_t need) {
  base_ = need;
  need_ = need;
  side_ = 0;
  rest(position);
}

// The drive turned around, or a load turns the shaft against it: the slowest shaft still runs the other way.
void EncoderWatch::turn(int32_t position, int32_t along) {
  mark_ = position;
  against_ = clamp(along, -MOVED_MOST, 0);
  momentum_ = against_ * (inertia_ / 8) * MOMENTUM_PER_KA_8;
}

void EncoderWatch::advance(int32_t position, int32_t moved, int32_t drive) {
  mark(position);
  advanced_ = true;
  need_ = base_;
  if (drive <= base_) return;
  // What moves only under more duty than `base_` needs it: the part of the duty that is not for its speed.
  const int64_t speed = static_cast<int64_t>(magnitude(clamp(moved, -MOVED_MOST, MOVED_MOST))) * kv_ * 125 >> 8;
  if (drive - speed > base_) need_ = static_cast<int32_t>(drive - speed);
}

void EncoderWatch::tick(int32_t position, int32_t moved, int32_t duty, bool excused) {
  const int32_t side = sign(duty);
  const int32_t along = side * moved;
  if (side != side_) {
    // Play is crossed before the encoder moves, once in a stroke. What a stroke without an advance owes, stays.
    const int32_t owed = advanced_ ? -play_ : owed_;
    side_ = side;
    advanced_ = false;
    mark(position);
    owed_ = owed;
    return turn(position, along);
  }
  const int32_t ahead = minus(position, mark_);
  along_ = side < 0 ? -ahead : ahead;
  const int32_t drive = side < 0 ? -duty : duty;
  if (along_ >= ADVANCE) return advance(position, moved, drive);
  ++idle_;
  if (position != last_) ++edges_;
  last_ = position;
  if (momentum_ < 0) {
    if (along >= against_ - JITTER && along < 0) {
      const int32_t brakes = drive - need_ / 2;  // against a load
      if (brakes > 0) momentum_ += brakes;
      mark_ = position;
      idle_ = 0;
      return;
    }
    momentum_ = 0;  // it has turned around, or accelerates against the drive
  }
  const int32_t excess = drive - need_;
  const bool behind = along_ <= -BACKWARD;
  backward_ = behind && along < 0;
  if (excess > 0 && (behind || !excused)) {
    momentum_ += behind ? drive : excess;  // no friction holds what runs backward
    owed_ += momentum_;
    return;
  }
  momentum_ = 0;
  if (excused) {
    owed_ = 0;
  } else if (along_ <= -BACKWARD) {
    owed_ = -play_;
    turn(position, along);
  }
}

}  // namespace contid
