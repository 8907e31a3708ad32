// Identity: start counter (GPBR), random number of the start (TRNG), chip id (flash controller), cause of the reset.
#ifdef ARDUINO_ARCH_SAM

#include "identity.h"

#include <Arduino.h>
#include <USB/PluggableUSB.h>

#include <string.h>

#ifndef CONTID_BUILD_ID
#define CONTID_BUILD_ID 0
#endif

namespace contid {

namespace {

const uint32_t START_READ_UNIQUE_ID = 0x0E;
const uint32_t STOP_READ_UNIQUE_ID = 0x0F;
const uint32_t FLASH_COMMAND_KEY = 0x5A;
const uint32_t TRNG_KEY = 0x524E47;  // "RNG"
const uint32_t RANDOM_TRIES = 1000;  // a number takes 84 clocks

// While the id is readable the flash is not: in RAM, without calls, and without interrupts, whose vectors are in
// flash. Sequential code optimisation off, as the datasheet demands for this command.
__attribute__((section(".ramfunc"), noinline, used)) void read_unique_id(uint32_t* id) {
  const volatile uint32_t* const flash = reinterpret_cast<const volatile uint32_t*>(IFLASH0_ADDR);
  EFC0->EEFC_FMR |= EEFC_FMR_SCOD;
  EFC0->EEFC_FCR = EEFC_FCR_FKEY(FLASH_COMMAND_KEY) | EEFC_FCR_FCMD(START_READ_UNIQUE_ID);
  while ((EFC0->EEFC_FSR & EEFC_FSR_FRDY) != 0) {
  }
  id[0] = flash[0];
  id[1] = flash[1];
  id[2] = flash[2];
  id[3] = flash[3];
  EFC0->EEFC_FCR = EEFC_FCR_FKEY(FLASH_COMMAND_KEY) | EEFC_FCR_FCMD(STOP_READ_UNIQUE_ID);
  while ((EFC0->EEFC_FSR & EEFC_FSR_FRDY) == 0) {
  }
  EFC0->EEFC_FMR &= ~EEFC_FMR_SCOD;
}

uint32_t random_number() {
  pmc_enable_periph_clk(ID_TRNG);
  TRNG->TRNG_CR = TRNG_CR_KEY(TRNG_KEY) | TRNG_CR_ENABLE;
  for (uint32_t i = 0; i < RANDOM_TRIES; ++i) {
    if ((TRNG->TRNG_ISR & TRNG_ISR_DATRDY) != 0) break;
  }
  return TRNG->TRNG_ODATA;
}

ResetCause reset_cause() {
  if ((SUPC->SUPC_SR & SUPC_SR_BODRSTS) != 0) return ResetCause::BROWN_OUT;
  const uint32_t type = (RSTC->RSTC_SR & RSTC_SR_RSTTYP_Msk) >> RSTC_SR_RSTTYP_Pos;
  return type <= 4 ? static_cast<ResetCause>(type) : ResetCause::POWER_UP;
}

// A USB module without interface or endpoint: the core takes the serial number of the device from its modules.
// Without one the number is empty, and all boards have the same name on the computer.
class UsbSerialNumber : public PluggableUSBModule {
 public:
  explicit UsbSerialNumber(uint64_t number) : PluggableUSBModule(0, 0, nullptr), number_(number) {}

 protected:
  bool setup(USBSetup&) override { return false; }
  int getInterface(uint8_t*) override { return 0; }
  int getDescriptor(USBSetup&) override { return 0; }
  // The core's buffer has 20 bytes.
  uint8_t getShortName(char* name) override {
    for (uint8_t i = 0; i < SERIAL_DIGITS; ++i) {
      name[i] = "0123456789ABCDEF"[static_cast<size_t>(number_ >> (60 - 4 * i)) & 15u];
    }
    return SERIAL_DIGITS;
  }

 private:
  static const uint8_t SERIAL_DIGITS = 16;
  const uint64_t number_;
};

// FNV-1a of 64 bits: the whole id does not fit the core's buffer.
uint64_t digest(const uint8_t* data, size_t size) {
  uint64_t value = 0xCBF29CE484222325u;
  for (size_t i = 0; i < size; ++i) value = (value ^ data[i]) * 0x100000001B3u;
  return value;
}

}  // namespace

void number_usb(const Identity& identity) {
  static UsbSerialNumber number(digest(identity.unique_id, sizeof(identity.unique_id)));
  PluggableUSB().plug(&number);
}

void read_identity(Identity& identity) {
  uint32_t id[UNIQUE_ID_SIZE / 4];
  __disable_irq();
  read_unique_id(id);
  __enable_irq();
  memcpy(identity.unique_id, id, sizeof(id));
  // A backup register: survives resets, not the loss of power.
  GPBR->SYS_GPBR[0] = GPBR->SYS_GPBR[0] + 1;
  identity.boot = static_cast<uint16_t>(GPBR->SYS_GPBR[0]);
  identity.boot_id = random_number();
  identity.build_id = CONTID_BUILD_ID;
  identity.cause = reset_cause();
}

}  // namespace contid

#endif  // ARDUINO_ARCH_SAM
