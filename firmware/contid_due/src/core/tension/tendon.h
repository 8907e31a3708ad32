// A tendon with a load cell: the fence that keeps its tension above a floor, and what shows that it is slack, has
// snapped or is pulled too hard.
#ifndef CONTID_TENDON_H
#define CONTID_TENDON_H

#include "../setpoint.h"
#include "load_cell.h"

namespace contid {

// The place of the shaft at which the tension is at its floor follows from the present place, the tension and the
// stiffness; an alpha-beta filter keeps it and its speed. The set-point of the motor stays on its tight side, and stops
// before it as before any demand: the tension does not fall below the floor, and a body that gives way is followed. A
// stiffness of the file above the true one makes the estimate approach in several steps, one below it overshoots.
class Tendon {
 public:
  void configure(const TensionConfig& config, int32_t position);
  // Timers and history start anew; the tendon is under power from now on, its shaft at `position`.
  void arm(int32_t position);
  // One tick, before the drive; `position` is that of the shaft [counts].
  void sense(const CellReading& reading, int32_t position);
  // One tick under power; `spent` when the shaft has taken up all that it may.
  void watch(bool spent);

  bool ok() const { return cell_.ok(); }
  Reason cell_fault() const { return cell_.fault(); }
  // Fault of the tendon or of its cell, under power.
  Reason fault() const { return fault_; }
  // [mN]
  int32_t tension() const { return cell_.tension(); }
  bool below() const { return cell_.tension() < config_->floor + MARGIN; }
  // Where the set-point must stay on the tight side of; `speed` is that of the shaft, in counts times 65536 per
  // tick.
  Fence fence(int64_t speed) const;
  // Part of a duty that may be driven: none that slackens on a cell that shows no tension.
  int32_t allowed(int32_t duty) const { return !ok() && duty * config_->pull < 0 ? 0 : duty; }
  const TensionConfig& config() const { return *config_; }
  // Way that changes the tension by the floor, of the stiffest tendon [counts].
  int32_t way() const;

 private:
  static const uint32_t HISTORY = 16;
  static const int32_t MARGIN = 100;  // above the floor [mN]

  bool snapped(int32_t position);
  void follow(int32_t position);

  const TensionConfig* config_;
  LoadCell cell_;
  int64_t give_q16_;   // counts per mN, times 65536
  int64_t at_, rate_;  // the fence, and its speed per tick; counts times 65536
  int32_t past_[HISTORY], place_[HISTORY];
  uint32_t kept_, newest_;
  int32_t position_;
  int32_t slack_ticks_, over_ticks_, spent_ticks_, snap_ticks_;
  bool known_;  // the fence has a first value
  Reason fault_;
};

}  // namespace contid

#endif
