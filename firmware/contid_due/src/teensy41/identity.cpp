// Identity of a Teensy 4.1: start counter (SNVS_LPGPR3), random number of the start (TRNG), chip id (fuses), cause of
// the reset (SRC_SRSR). The core gives the USB device a serial number of its own.
#ifdef ARDUINO_TEENSY41

#include "identity.h"

#include <Arduino.h>

#include <string.h>

#ifndef CONTID_BUILD_ID
#define CONTID_BUILD_ID 0
#endif

namespace contid {

namespace {

// TRNG_MCTL: entropy valid, reset to defaults, programming mode, error; samples by von Neumann, statistics raw.
const uint32_t VALID = 1u << 10, DEFAULTS = 1u << 6, PROGRAM = 1u << 16, FAILED = 1u << 12, SAMPLES = 2;
const uint32_t RANDOM_TRIES = 10000000;  // about 0.2 s; a number takes some 10 ms

uint32_t random_number() {
  CCM_CCGR6 |= CCM_CCGR6_TRNG(CCM_CCGR_ON);
  TRNG_MCTL = PROGRAM | FAILED | DEFAULTS;
  TRNG_MCTL = SAMPLES;
  for (uint32_t i = 0; i < RANDOM_TRIES; ++i) {
    if ((TRNG_MCTL & (VALID | FAILED)) != 0) break;
  }
  // Without a valid number the cycle counter differs between starts, by the time that USB took.
  return TRNG_ENT0 ^ ARM_DWT_CYCCNT;
}

// The flags stay until they are cleared. The counter is lost with the power; a board with a coin cell keeps it, and
// takes its power-up for a reset: its motors without homing must be parked.
ResetCause reset_cause(bool counted) {
  const uint32_t flags = SRC_SRSR;
  SRC_SRSR = flags;
  if ((flags & (SRC_SRSR_WDOG_RST_B | SRC_SRSR_WDOG3_RST_B)) != 0) return ResetCause::WATCHDOG;
  if ((flags & (SRC_SRSR_LOCKUP_SYSRESETREQ | SRC_SRSR_JTAG_SW_RST)) != 0) return ResetCause::SOFTWARE;
  return counted ? ResetCause::PIN : ResetCause::POWER_UP;
}

}  // namespace

void read_identity(Identity& identity) {
  const uint32_t id[UNIQUE_ID_SIZE / 4] = {HW_OCOTP_CFG0, HW_OCOTP_CFG1, HW_OCOTP_MAC0, HW_OCOTP_MAC1};
  memcpy(identity.unique_id, id, sizeof(id));
  identity.cause = reset_cause(SNVS_LPGPR3 != 0);
  const uint32_t boot = SNVS_LPGPR3 + 1;
  SNVS_LPGPR3 = boot;
  identity.boot = static_cast<uint16_t>(boot);
  identity.boot_id = random_number();
  identity.build_id = CONTID_BUILD_ID;
}

}  // namespace contid

#endif  // ARDUINO_TEENSY41
