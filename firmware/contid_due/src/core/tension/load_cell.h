// A load cell in a tendon, behind an amplifier at an analogue pin or behind a converter: tension, and whether it is
// one.
#ifndef CONTID_LOAD_CELL_H
#define CONTID_LOAD_CELL_H

#include "../config.h"

namespace contid {

// The reading of one tick: of both kinds, the configuration chooses one. `fresh`: the converter finished since the tick
// before.
struct CellReading {
  int32_t analog, converted;
  bool fresh;
};

class LoadCell {
 public:
  void configure(const TensionConfig& config);
  // One tick; `position` is that of the shaft [counts].
  void sense(const CellReading& reading, int32_t position);

  // The count of the shaft begins anew: its jump is no way.
  void place(int32_t position) {
    least_ = position;
    most_ = position;
  }

  // The newest reading is a tension. False from the first reading on that is none.
  bool ok() const { return primed_ && bad_ticks_ == 0 && !frozen_; }
  // Why it has been none for long enough; NONE while it may be a disturbance.
  Reason fault() const;
  // [mN]; of a converter the newest.
  int32_t tension() const { return tension_; }
  // This tick brought a reading.
  bool fresh() const { return fresh_; }

 private:
  static const uint32_t WINDOW = 4;

  bool frozen(int32_t raw, int32_t position);

  const TensionConfig* config_;
  int64_t slope_q20_;  // mN per step of the sum, times 2^20
  int32_t steps_;      // readings in the sum
  int32_t readings_[WINDOW], sum_;
  uint32_t at_;
  int32_t tension_;
  int32_t bad_ticks_, silent_ticks_;
  int32_t same_, raw_, least_, most_;  // readings alike, and the way of the shaft since then
  bool primed_, fresh_, frozen_;
};

}  // namespace contid

#endif
