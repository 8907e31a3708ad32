// What the hardware layer reads for one tick.
#ifndef CONTID_INPUTS_H
#define CONTID_INPUTS_H

#include <stdint.h>

#include "protocol.h"

namespace contid {

struct Inputs {
  int32_t count[CHANNELS];
  int32_t analog[CHANNELS];   // 12 bit
  uint8_t bridge_faults;      // one bit per channel whose H-bridge reports a fault
  uint32_t missed[CHANNELS];  // encoder edges missed since the start
  // Level changes of the tracks since the start: every one of an edge decoder; of a hardware decoder those that
  // samples of 1 ms show, which are fewer.
  uint32_t edges_a[CHANNELS], edges_b[CHANNELS];
  bool supply_low;  // the 3.3 V were below their threshold since the last tick
};

}  // namespace contid

#endif
