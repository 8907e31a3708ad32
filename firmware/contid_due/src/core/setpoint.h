// The set-point of a motor: goes to the demand within velocity and acceleration limits, one step a tick.
#ifndef CONTID_SETPOINT_H
#define CONTID_SETPOINT_H

#include <stdint.h>

namespace contid {

// A place that the set-point does not pass: it stays on the side `side`, as if demanded there. It goes at `rate` per
// tick, and takes no more than `reach` from the demand. Places are counts times 65536.
struct Fence {
  int32_t side;
  int64_t at, rate, reach;
  bool stands;  // false: there is none
};

class SetPoint {
 public:
  // Limits in counts/s and counts/s2.
  void limit(int32_t velocity, int32_t acceleration);
  // Stand still at a position [counts].
  void start(int32_t position);
  // A new demand [counts], `since` ticks after the one before. Demands that follow each other within the
  // velocity limit are joined by a straight line over that time, so a stream of them is a smooth motion.
  // With its velocity [counts/s] the line goes through the demand at once instead of two demands late; without a
  // further demand it ends there, two intervals later.
  void demand(int32_t goal, uint32_t since, int32_t velocity);
  // Come to rest as soon as the acceleration limit allows.
  void stop();
  void tick(const Fence* fence = nullptr);

  int64_t position_q16() const { return position_; }
  int32_t position() const { return static_cast<int32_t>(position_ >> 16); }
  // [counts/s], [counts/s2]
  int32_t velocity() const;
  int32_t acceleration() const;
  int32_t goal() const { return goal_; }
  int64_t speed_q16() const { return velocity_; }  // per tick
  bool moving() const { return velocity_ != 0; }
  // The fence kept it from its demand in the newest tick, or took all that it may.
  bool fenced() const { return fenced_; }
  bool spent() const { return spent_; }

 private:
  static int64_t stopping_speed(int64_t distance, int64_t acceleration);
  int64_t keep_inside(const Fence& fence, int64_t rate, int64_t target);

  int64_t position_;   // counts times 65536
  int64_t reference_;  // where the demand is now, on its line
  int64_t rate_;       // of the reference, per tick
  int32_t velocity_;   // counts times 65536 per tick
  int64_t smooth_;     // its change per tick, averaged, times 32
  int32_t most_;       // velocity limit, as velocity_
  int32_t step_;       // acceleration limit: greatest change of velocity_ per tick
  uint32_t left_;      // ticks of the line still to go
  uint32_t interval_;  // of the demands of a stream [ticks], averaged; 0 before the second
  int32_t goal_;
  bool fenced_, spent_;
};

}  // namespace contid

#endif
