// The identity of boards that have no chip: of the emulator, the shared vectors and the Cortex-M3 tests.
#ifndef CONTID_HOST_IDENTITY_H
#define CONTID_HOST_IDENTITY_H

#include "../contid_due/src/core/board.h"

#ifndef CONTID_BUILD_ID
#define CONTID_BUILD_ID 0
#endif

namespace contid {

const uint32_t FIRST_BOOT_ID = 0xB0071D00;

inline uint8_t emulated_capability(Role role) {
  return role == Role::MOTOR ? CURRENT_SENSE | BRIDGE_FAULT | CELL_ANALOG | CELL_CONVERTER : READ_BACK | VALVE_PAIR;
}

inline Identity emulated_identity(Role role) {
  Identity identity = Identity();
  identity.role = role;
  identity.boot = 1;
  identity.boot_id = FIRST_BOOT_ID;
  identity.build_id = CONTID_BUILD_ID;
  for (uint8_t i = 0; i < UNIQUE_ID_SIZE; ++i) identity.unique_id[i] = static_cast<uint8_t>(0xE0 + i);
  for (uint8_t i = 0; i < CHANNELS; ++i) identity.capabilities[i] = emulated_capability(role);
  identity.pins = "emulated";
  identity.bridges = role == Role::MOTOR ? ALL_BRIDGES : 0;
  identity.adc_steps = 4095;
  identity.adc_mv = 3300;
  return identity;
}

}  // namespace contid

#endif
