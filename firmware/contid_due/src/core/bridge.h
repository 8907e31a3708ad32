// The lines of an H-bridge for what a motor is to do, by type of bridge.
#ifndef CONTID_BRIDGE_H
#define CONTID_BRIDGE_H

#include "motor.h"

namespace contid {

// Levels of a channel's two inputs, and the duty of its PWM line [0 .. DUTY_FULL].
struct Lines {
  bool driven;  // false: the pins are inputs, and the pull resistors of the wiring decide
  bool in_a, in_b;
  int32_t pwm;
};

Lines bridge_lines(Bridge bridge, const Output& out);

// Whether pull resistors at the undriven lines of this bridge can give the state.
bool can_start(Bridge bridge, Safe start);

}  // namespace contid

#endif
