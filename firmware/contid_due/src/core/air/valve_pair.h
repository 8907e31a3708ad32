// Two on/off valves at a chamber: an inlet from the supply, an outlet to the surroundings. In pulses, by the reading.
#ifndef CONTID_VALVE_PAIR_H
#define CONTID_VALVE_PAIR_H

#include "../config.h"
#include "../motor.h"

namespace contid {

// One direction of flow: what its pulses did to the reading.
struct Flow {
  int32_t gain_q4;  // change per ms of opening [Pa] times 16; 0: unknown
  int32_t least;    // least change that a pulse made [Pa]; 0: unknown
  int32_t last_ms;  // of the newest pulse; 0: start with the shortest
  int32_t at;       // reading at its end [Pa]
};

class ValvePair {
 public:
  void configure(const RegulatorConfig& config);
  // Nothing that pulses did is used any more.
  void forget();

  // One tick towards a set-point [Pa]; `rate` is that of the reading [Pa/s].
  Output follow(int32_t set, int32_t pressure, int32_t rate);
  // The outlet stays open.
  Output empty();

 private:
  enum class Flowing : uint8_t { NONE = 0, IN = 1, OUT = 2 };

  void begin(int32_t off, int32_t pressure);
  void settle(int32_t pressure);
  int32_t width(const Flow& flow, int32_t off) const;
  Output lines() const;

  const RegulatorConfig* config_;
  Flow in_, out_;
  Flowing flowing_, measured_;
  int32_t ticks_, width_, wait_;
  int32_t from_;  // reading before the pulse
};

}  // namespace contid

#endif
