// What the hardware layer needs of the Arduino core, for builds without it: start-up, pins, waits, pin interrupts.
// It follows the core in what it leaves behind: every pin an input without pull-up, interrupts of all ports enabled
// at priority 0 by the first attachInterrupt(), UOTGHS at priority 0, the watchdog set up before anything else.
#include <Arduino.h>
#include <USB/PluggableUSB.h>

void setup();
void loop();

extern "C" {

// The pins of pins.h: Arduino number to port and bit (schematic of the Arduino Due).
#define PIN(port, bit) {PIO##port, 1u << (bit)}
#define NONE {PIOA, 0}
extern const PinDescription g_APinDescription[] = {
    NONE,       NONE,       PIN(B, 25), NONE,       PIN(C, 26), PIN(C, 25), PIN(C, 24), PIN(C, 23),  // 0 .. 7
    PIN(C, 22), PIN(C, 21), PIN(C, 29), PIN(D, 7),  PIN(D, 8),  PIN(B, 27), PIN(D, 4),  PIN(D, 5),   // 8 .. 15
    PIN(A, 13), PIN(A, 12), PIN(A, 11), PIN(A, 10), NONE,       NONE,       PIN(B, 26), PIN(A, 14),  // 16 .. 23
    PIN(A, 15), PIN(D, 0),  PIN(D, 1),  PIN(D, 2),  PIN(D, 3),  PIN(D, 6),  PIN(D, 9),  PIN(A, 7),   // 24 .. 31
    PIN(D, 10), PIN(C, 1),  PIN(C, 2),  PIN(C, 3),  PIN(C, 4),  PIN(C, 5),  PIN(C, 6),  PIN(C, 7),   // 32 .. 39
    PIN(C, 8),  PIN(C, 9),  PIN(A, 19), PIN(A, 20), PIN(C, 19), PIN(C, 18), PIN(C, 17), PIN(C, 16),  // 40 .. 47
    PIN(C, 15), PIN(C, 14), PIN(C, 13), PIN(C, 12), PIN(B, 21), PIN(B, 14),                          // 48 .. 53
};

typedef void (*Callback)();
static Callback callbacks[32];
static bool attached;

static volatile uint8_t* const priorities = (volatile uint8_t*)0xE000E400u;
static volatile uint32_t* const set_enable = (volatile uint32_t*)0xE000E100u;
static volatile uint32_t* const clear_enable = (volatile uint32_t*)0xE000E180u;
static volatile uint32_t* const set_pending = (volatile uint32_t*)0xE000E200u;
static volatile uint32_t* const clear_pending = (volatile uint32_t*)0xE000E280u;

void NVIC_SetPriority(IRQn_Type irq, uint32_t priority) { priorities[irq] = (uint8_t)(priority << 4); }
void NVIC_EnableIRQ(IRQn_Type irq) { set_enable[irq / 32] = 1u << irq % 32; }
void NVIC_DisableIRQ(IRQn_Type irq) { clear_enable[irq / 32] = 1u << irq % 32; }
uint32_t NVIC_GetPendingIRQ(IRQn_Type irq) { return set_pending[irq / 32] >> irq % 32 & 1u; }
void NVIC_ClearPendingIRQ(IRQn_Type irq) { clear_pending[irq / 32] = 1u << irq % 32; }
void __DSB(void) { __asm volatile("dsb" ::: "memory"); }
void __disable_irq(void) { __asm volatile("cpsid i" ::: "memory"); }
void __enable_irq(void) { __asm volatile("cpsie i" ::: "memory"); }
void __ISB(void) { __asm volatile("isb" ::: "memory"); }

uint32_t pmc_enable_periph_clk(uint32_t id) {
  if (id < 32) {
    PMC->PMC_PCER0 = 1u << id;
  } else {
    PMC->PMC_PCER1 = 1u << (id - 32);
  }
  return 0;
}

uint32_t PIO_Configure(Pio* port, EPioType type, uint32_t mask, uint32_t attribute) {
  port->PIO_IDR = mask;
  if ((attribute & PIO_PULLUP) != 0) {
    port->PIO_PUER = mask;
  } else {
    port->PIO_PUDR = mask;
  }
  if (type == PIO_PERIPH_B) {
    port->PIO_ABSR |= mask;
    port->PIO_PDR = mask;
  } else if (type == PIO_OUTPUT_0) {
    port->PIO_CODR = mask;
    port->PIO_OER = mask;
    port->PIO_PER = mask;
  } else {
    port->PIO_ODR = mask;
    port->PIO_PER = mask;
  }
  return 1;
}

void pinMode(uint32_t pin, uint32_t mode) {
  const PinDescription& one = g_APinDescription[pin];
  PIO_Configure(one.pPort, mode == OUTPUT ? PIO_OUTPUT_0 : PIO_INPUT, one.ulPin,
                mode == INPUT_PULLUP ? PIO_PULLUP : PIO_DEFAULT);
}

// Four cycles or more per turn at 84 MHz.
void delayMicroseconds(uint32_t us) {
  for (volatile uint32_t turns = us * 21; turns > 0; turns = turns - 1) {
  }
}
void delay(uint32_t ms) { delayMicroseconds(1000 * ms); }

void attachInterrupt(uint32_t pin, void (*callback)(void), uint32_t) {
  for (uint32_t irq = 11; irq <= 14 && !attached; ++irq) {
    pmc_enable_periph_clk(irq);
    NVIC_SetPriority((IRQn_Type)irq, 0);
    NVIC_EnableIRQ((IRQn_Type)irq);
  }
  attached = true;
  const uint32_t mask = g_APinDescription[pin].ulPin;
  for (uint32_t bit = 0; bit < 32; ++bit) {
    if ((mask >> bit & 1u) != 0) callbacks[bit] = callback;
  }
  PIOD->PIO_AIMDR = mask;
  PIOD->PIO_IER = mask;
}

void PIOD_Handler(void) {
  const uint32_t changed = PIOD->PIO_ISR;
  for (uint32_t bit = 0; bit < 32; ++bit) {
    if ((changed >> bit & 1u) != 0 && callbacks[bit] != nullptr) callbacks[bit]();
  }
}

void TC3_Handler(void);
void halt(void) {
  while (true) {
  }
}

extern char usb_serial_number[];
extern uint32_t stack_top, data_from, data_start, data_end, bss_start, bss_end;

void Reset_Handler(void) {
  const uint32_t* from = &data_from;
  for (uint32_t* to = &data_start; to < &data_end; ++to) *to = *from++;
  for (volatile uint32_t* to = &bss_start; to < &bss_end; ++to) *to = 0;
  watchdogSetup();
  NVIC_EnableIRQ(UOTGHS_IRQn);
  setup();
  PluggableUSB().getShortName(usb_serial_number);
  while (true) loop();
}

struct Vectors {
  uint32_t* stack;
  void (*handler[60])(void);
};
#define HALT4 halt, halt, halt, halt
__attribute__((section(".vectors"), used)) const Vectors vectors = {
    &stack_top, {Reset_Handler, halt,  halt,  HALT4,       HALT4, HALT4,  // 1 .. 15
                 HALT4,         HALT4, HALT4, halt,        halt,  PIOD_Handler, halt,  HALT4, HALT4,
                 HALT4,         halt,  halt,  TC3_Handler, halt,  HALT4,        HALT4, halt,  halt}};

void* memset(void* to, int value, size_t size) {
  volatile uint8_t* bytes = static_cast<uint8_t*>(to);
  for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<uint8_t>(value);
  return to;
}

void* memcpy(void* to, const void* from, size_t size) {
  volatile uint8_t* bytes = static_cast<uint8_t*>(to);
  const uint8_t* source = static_cast<const uint8_t*>(from);
  for (size_t i = 0; i < size; ++i) bytes[i] = source[i];
  return to;
}

}  // extern "C"

// What the core would send as serial number of the device.
extern "C" {
char usb_serial_number[20];
void __cxa_pure_virtual(void) { halt(); }
}
static PluggableUSB_ plugged;
PluggableUSB_& PluggableUSB() { return plugged; }

bool Serial_::dtr() { return true; }
Serial_ SerialUSB;
