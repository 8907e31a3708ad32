// Sums the drive that the count does not answer.
//
// | the shaft | mark             | momentum                       | the count owes                  |
// | --------- | ---------------- | ------------------------------ | ------------------------------- |
// | TURNED    | here, other side | of its speed, against          | as before; -play if it advanced |
// | ADVANCED  | here             | 0                              | 0; the duty it needs is learnt  |
// | RUNS_OUT  | here             | + drive - need / 2 (above 0)   | as before                       |
// | OWES      | stays            | + drive - need (behind: drive) | + momentum; failed above limit  |
// | EXCUSED   | stays            | 0                              | 0                               |
// | GIVES_WAY | here             | of its speed, against          | -play                           |
// | MAY_STAND | stays            | 0                              | as before                       |
//
// What each is, in the order of judgement: EncoderWatch::Shaft.
#include "encoder_watch.h"

#include "fixed.h"

namespace contid {

namespace {
const int32_t ADVANCE = 2;      // counts; one open track never shows more than one
const int32_t BACKWARD = 3;     // counts
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
void EncoderWatch::turn(int32_t position, int32_t speed) {
  mark_ = position;
  against_ = clamp(speed, -MOVED_MOST, 0);
  momentum_ = against_ * (inertia_ / 8) * MOMENTUM_PER_KA_8;
}

// What moves only under more duty than `base_` needs it: the part of the duty that is not for its speed.
void EncoderWatch::learn_need(int32_t speed, int32_t drive) {
  const int64_t for_speed = static_cast<int64_t>(magnitude(clamp(speed, -MOVED_MOST, MOVED_MOST))) * kv_ * 125 >> 8;
  const int64_t rest = drive - for_speed;
  need_ = rest > base_ ? static_cast<int32_t>(rest) : base_;
}

EncoderWatch::Shaft EncoderWatch::judge(const Seen& seen) const {
  if (seen.side != side_) return Shaft::TURNED;
  if (seen.ahead >= ADVANCE) return Shaft::ADVANCED;
  if (momentum_ < 0 && seen.speed < 0 && seen.speed >= against_ - JITTER) return Shaft::RUNS_OUT;
  if (seen.drive > need_ && (seen.behind || !seen.excused)) return Shaft::OWES;
  if (seen.excused) return Shaft::EXCUSED;
  return seen.behind ? Shaft::GIVES_WAY : Shaft::MAY_STAND;
}

void EncoderWatch::tick(int32_t position, int32_t moved, int32_t duty, bool excused) {
  const int32_t side = sign(duty);
  const int32_t ahead = side < 0 ? minus(mark_, position) : minus(position, mark_);
  const Seen seen = {side, magnitude(duty), ahead, side * moved, ahead <= -BACKWARD, excused};
  const Shaft shaft = judge(seen);
  if (shaft != Shaft::TURNED && shaft != Shaft::ADVANCED) {
    ++idle_;
    if (position != last_) ++edges_;
    last_ = position;
    // One that has turned around, or accelerates against the drive, has lost its momentum.
    if (shaft != Shaft::RUNS_OUT) {
      backward_ = seen.behind && seen.speed < 0;
      if (shaft != Shaft::OWES || momentum_ < 0) momentum_ = 0;
    }
  }
  switch (shaft) {
    case Shaft::TURNED: {
      // Play is crossed before the encoder moves, once in a stroke. What a stroke without an advance owes, stays.
      const int32_t owed = advanced_ ? -play_ : owed_;
      mark(position);
      turn(position, seen.speed);
      owed_ = owed;
      side_ = side;
      advanced_ = false;
      break;
    }
    case Shaft::ADVANCED:
      mark(position);
      learn_need(seen.speed, seen.drive);
      advanced_ = true;
      break;
    case Shaft::RUNS_OUT:
      if (seen.drive > need_ / 2) momentum_ += seen.drive - need_ / 2;  // need / 2: against a load
      mark_ = position;
      idle_ = 0;
      break;
    case Shaft::OWES:
      momentum_ += seen.behind ? seen.drive : seen.drive - need_;  // no friction holds what runs backward
      owed_ += momentum_;
      break;
    case Shaft::EXCUSED:
      owed_ = 0;
      break;
    case Shaft::GIVES_WAY:
      owed_ = -play_;
      turn(position, seen.speed);
      break;
    case Shaft::MAY_STAND:
      break;
  }
}

}  // namespace contid
