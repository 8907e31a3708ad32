// Generates the set-point of a motor: a time-optimal profile per tick in fixed point, with stream interpolation.
#include "setpoint.h"

#include "fixed.h"
#include "protocol.h"

namespace contid {

namespace {
// Demands further apart than this [ticks] are steps, not a stream.
const uint32_t STREAM_GAP = 100;
// Ticks over which the acceleration of a stream is averaged before it is fed forward, because rounded demands
// jitter. The acceleration of a step is fed forward at once.
const int32_t SMOOTH = 32;
// Share of the acceleration limit that the commands of a stream leave: the host requires a fifth above theirs.
const int32_t STREAM_RESERVE = 6;
// Distances are clamped to this; keeps 8 a d inside 64 bit.
const int64_t FAR = static_cast<int64_t>(1) << 34;
}  // namespace

void SetPoint::limit(int32_t velocity, int32_t acceleration) {
  most_ = static_cast<int32_t>(static_cast<int64_t>(velocity) * 65536 / static_cast<int32_t>(TICK_HZ));
  most_ -= most_ / 64;  // the rest of the limit is reserved for a shaft that catches up
  step_ = static_cast<int32_t>(static_cast<int64_t>(acceleration) * 65536 / (TICK_HZ * TICK_HZ));
}

void SetPoint::start(int32_t position) {
  position_ = static_cast<int64_t>(position) * 65536;
  reference_ = position_;
  rate_ = 0;
  velocity_ = 0;
  smooth_ = 0;
  left_ = 0;
  interval_ = 0;
  goal_ = position;
  fenced_ = false;
  spent_ = false;
}

void SetPoint::demand(int32_t goal, uint32_t since, int32_t velocity) {
  const int64_t target = static_cast<int64_t>(goal) * 65536;
  goal_ = goal;
  // A quarter above the velocity limit: a stream of a jittering host is still a stream.
  const int64_t reach = static_cast<int64_t>(most_ + most_ / 4) * 2 * since;
  if (since >= 1 && since <= STREAM_GAP && magnitude64(target - reference_) <= reach) {
    // Spread over two intervals: errors by the host's jitter and by rounding to counts cancel in the next one, and
    // the reference does not stop when a demand is a tick late.
    // The mean of late and early demands is the interval of their stream.
    interval_ = interval_ == 0 ? since : (3 * interval_ + since + 2) / 4;
    left_ = 2 * interval_;
    rate_ = (target - reference_) / static_cast<int32_t>(left_);
    if (velocity != NO_VELOCITY) {
      const int64_t given = static_cast<int64_t>(velocity) * 65536 / static_cast<int32_t>(TICK_HZ);
      rate_ += clamp64(given, -(most_ + most_ / 4), most_ + most_ / 4);
    }
  } else {
    reference_ = target;
    rate_ = 0;
    left_ = 0;
    interval_ = 0;
  }
}

void SetPoint::stop() {
  const int64_t distance = static_cast<int64_t>(velocity_) * velocity_ / (2 * static_cast<int64_t>(step_));
  reference_ = position_ + sign(velocity_) * distance;
  goal_ = static_cast<int32_t>(reference_ >> 16);
  rate_ = 0;
  left_ = 0;
}

// Highest speed from which steps v, v - a, v - 2a, .. stay within the distance: v (v + a) = 2 a d.
int64_t SetPoint::stopping_speed(int64_t distance, int64_t a) {
  const int64_t d = distance < FAR ? distance : FAR;
  const int64_t root = square_root(static_cast<uint64_t>(a * a + 8 * a * d));
  const int64_t speed = (root - a) / 2;
  // Nearer than one step the formula would overshoot; there the distance itself is the speed.
  return speed < d ? speed : d;
}

// At least the speed from which the set-point comes to the fence, or along with it, within the acceleration limit.
int64_t SetPoint::keep_inside(const Fence& fence, int64_t rate, int64_t target) {
  // A demand that tightens shows that a body comes, which a capstan may hide from the cell until it lets go all at
  // once. The way on which the set-point catches up with a body at 1.4 times its speed is kept beforehand.
  const int64_t coming = fence.side * rate > 0 ? rate * rate / step_ : 0;
  const int64_t place = fence.at + fence.side * coming;
  const int64_t furthest = reference_ + fence.side * fence.reach;
  const bool beyond = fence.side * (place - furthest) > 0;
  const int64_t off = (beyond ? furthest : place) - position_;
  // Before the fence it slows down with an eighth of the limit: the shaft lags behind.
  const int64_t way = fence.side * off < 0 ? magnitude64(off) / 8 : magnitude64(off);
  const int64_t least = (beyond ? 0 : fence.rate) + sign(off) * stopping_speed(way, step_);
  fenced_ = fence.stands && fence.side * (least - target) > 0;
  spent_ = fenced_ && beyond;
  return fenced_ ? least : target;
}

void SetPoint::tick(const Fence* fence) {
  int64_t rate = 0;
  if (left_ != 0) {
    rate = rate_;
    reference_ += rate_;
    if (--left_ == 0) reference_ = static_cast<int64_t>(goal_) * 65536;
  }
  const int64_t error = reference_ - position_;
  // The rate covers the error caused by the reference's motion in this tick.
  const int64_t behind = error - rate;
  // Beside a stream, which may brake at any time with what its reserve leaves of the limit, the set-point catches up
  // with no more than it can brake then: else a late demand ends beyond the last one.
  const int64_t brake = rate != 0 ? step_ / STREAM_RESERVE + 1 : step_;
  int64_t target = rate + sign(behind) * stopping_speed(magnitude64(behind), brake);
  if (fence != nullptr) target = keep_inside(*fence, rate, target);
  target = clamp64(target, -most_, most_);
  const int32_t change = static_cast<int32_t>(clamp64(target - velocity_, -step_, step_));
  velocity_ += change;
  const int64_t newer = static_cast<int64_t>(change) * SMOOTH - smooth_;
  smooth_ += rate != 0 ? newer / SMOOTH : newer;
  position_ += velocity_;
}

int32_t SetPoint::velocity() const {
  return static_cast<int32_t>((static_cast<int64_t>(velocity_) * static_cast<int32_t>(TICK_HZ)) >> 16);
}

int32_t SetPoint::acceleration() const {
  const int64_t ticks2 = static_cast<int64_t>(TICK_HZ) * TICK_HZ;
  return static_cast<int32_t>((smooth_ / SMOOTH * ticks2) >> 16);
}

}  // namespace contid
