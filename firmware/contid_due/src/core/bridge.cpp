// Truth tables of the supported H-bridges, from their data sheets.
//
//            PWM_IN_IN (VNH5019, L298)    TB6612          IN_IN (DRV8833, DRV8871)   DIR_PWM (DRV8838, MD10C)
// lines      PWM = EN, in_a, in_b         the same        IN1 = PWM, IN2 = in_a      PWM, DIR = in_a
// coast      L, L, PWM L                  L, L, PWM H     L, L                       not possible: brakes
// brake      H, H, PWM H                  H, H            H, H                       PWM L
#include "bridge.h"

#include "fixed.h"

namespace contid {

Lines bridge_lines(Bridge bridge, const Output& out) {
  if (out.drive == Drive::OFF) return Lines{false, false, false, 0};
  const int32_t duty = out.drive == Drive::RUN ? out.duty : 0;
  const int32_t size = magnitude(duty);
  const bool back = duty < 0;
  const bool brake = out.drive == Drive::BRAKE;
  switch (bridge) {
    case Bridge::IN_IN:
      if (brake) return Lines{true, true, false, DUTY_FULL};
      // Forward the PWM line drives and coasts; backward, with IN2 high, its low part drives and its high part brakes.
      return Lines{true, back, false, back ? DUTY_FULL - size : size};
    case Bridge::DIR_PWM:
      return Lines{true, back, false, size};
    default:
      if (brake) return Lines{true, true, true, DUTY_FULL};
      if (out.drive == Drive::COAST) return Lines{true, false, false, bridge == Bridge::TB6612 ? DUTY_FULL : 0};
      return Lines{true, !back, back, size};
  }
}

bool can_start(Bridge bridge, Safe start) {
  return start == Safe::BRAKE || (start == Safe::COAST && bridge != Bridge::DIR_PWM);
}

}  // namespace contid
