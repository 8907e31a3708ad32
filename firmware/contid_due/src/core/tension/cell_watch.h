// Whether a cell answers its own motor: a tendon that is pulled alone shows it at its own cell first.
#ifndef CONTID_CELL_WATCH_H
#define CONTID_CELL_WATCH_H

#include "../fixed.h"
#include "../protocol.h"

namespace contid {

// What the watch sees of one channel; without a cell it is no witness.
struct Pulled {
  bool cell;
  int32_t position, tension, pull, way, floor;  // counts; mN; way that changes the tension by the floor
};

class CellWatch {
 public:
  void reset() {
    started_ = false;
    for (uint8_t& strike : strikes_) strike = 0;
  }

  // One tick; the channel whose cell is that of another tendon, or NO_CHANNEL. Four motions in a row that only another
  // cell answers, each of one motor alone, are needed: a body that is moved may move any tension.
  uint8_t tick(const Pulled (&now)[CHANNELS]) {
    if (!started_ || ++age_ms_ > WINDOW_MS) return start(now);
    for (uint8_t i = 0; i < CHANNELS; ++i) {
      if (!now[i].cell || magnitude(minus(now[i].position, from_[i].position)) < now[i].way) continue;
      const uint8_t wrong = judge(i, now) ? i : NO_CHANNEL;
      start(now);
      return wrong;
    }
    return NO_CHANNEL;
  }

 private:
  static const int32_t WINDOW_MS = 500;
  static const uint8_t STRIKES = 4;

  uint8_t start(const Pulled (&now)[CHANNELS]) {
    for (uint8_t i = 0; i < CHANNELS; ++i) from_[i] = now[i];
    started_ = true;
    age_ms_ = 0;
    return NO_CHANNEL;
  }

  // Channel i went its way: true after the fourth that another cell answered at four times its own.
  bool judge(uint8_t i, const Pulled (&now)[CHANNELS]) {
    const int32_t along = sign(minus(now[i].position, from_[i].position)) * now[i].pull;
    const int32_t own = along * minus(now[i].tension, from_[i].tension);
    int32_t other = 0;
    for (uint8_t j = 0; j < CHANNELS; ++j) {
      if (j == i || !now[j].cell) continue;
      if (magnitude(minus(now[j].position, from_[j].position)) > now[j].way / 8 + 1) return false;  // not alone
      const int32_t answer = along * minus(now[j].tension, from_[j].tension);
      if (answer > other) other = answer;
    }
    if (other < now[i].floor / 2) return false;
    strikes_[i] = own < other / 4 ? static_cast<uint8_t>(strikes_[i] + 1) : static_cast<uint8_t>(0);
    return strikes_[i] >= STRIKES;
  }

  Pulled from_[CHANNELS];
  int32_t age_ms_;
  uint8_t strikes_[CHANNELS];
  bool started_;
};

}  // namespace contid

#endif
