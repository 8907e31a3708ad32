// Every name that hal_*.cpp may use of the Arduino SAM core, and nothing else: what is not here does not compile
// in the test, so a name that the Due's core lacks cannot creep in. Registers: sam3x.h. Where each was read:
//   ArduinoCore-sam cores/arduino: Arduino.h, wiring*.h, WInterrupts.h, watchdog.h, UARTClass.h, USB/USBAPI.h,
//   USB/USBDesc.h, USB/CDC.cpp; variants/arduino_due_x/variant.{h,cpp}; libsam pio.h, pmc.h; CMSIS core_cm3.h,
//   core_cmInstr.h (NVIC_*, __DSB, __ISB)
#ifndef ARDUINO_SAM_NAMES_H
#define ARDUINO_SAM_NAMES_H

#include <stddef.h>
#include <stdint.h>

#include "sam3x.h"

#define VARIANT_MCK 84000000

// Macros of the core that a careless name in our sources would collide with.
#define PI 3.1415926535897932
#define HALF_PI 1.5707963267948966
#define EULER 2.718281828459045
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define constrain(amt, low, high) ((amt) < (low) ? (low) : ((amt) > (high) ? (high) : (amt)))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x) - 0.5))
#define radians(deg) ((deg) * 0.017453292519943295)
#define degrees(rad) ((rad) * 57.29577951308232)
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
#define lowByte(w) ((uint8_t)((w) & 0xff))
#define highByte(w) ((uint8_t)((w) >> 8))
#define interrupts() 0
#define noInterrupts() 0
#define LSBFIRST 0
#define MSBFIRST 1
#define DEFAULT 1
#define EXTERNAL 0
#define DISPLAY 1
#define SERIAL 0
#define F_CPU 84000000L

#define LOW 0x0
#define HIGH 0x1
#define INPUT 0x0
#define OUTPUT 0x1
#define INPUT_PULLUP 0x2
#define CHANGE 2
#define FALLING 3
#define RISING 4

extern "C" {

// CMSIS
typedef enum { UART_IRQn = 8, TC3_IRQn = 30, UOTGHS_IRQn = 40 } IRQn_Type;
void NVIC_SetPriority(IRQn_Type irq, uint32_t priority);
void NVIC_EnableIRQ(IRQn_Type irq);
void NVIC_DisableIRQ(IRQn_Type irq);
void NVIC_ClearPendingIRQ(IRQn_Type irq);
uint32_t NVIC_GetPendingIRQ(IRQn_Type irq);
void __DSB(void);
void __ISB(void);
void __disable_irq(void);
void __enable_irq(void);

// libsam
typedef enum { PIO_PERIPH_B, PIO_INPUT, PIO_OUTPUT_0 } EPioType;
#define PIO_DEFAULT (0u << 0)
#define PIO_PULLUP (1u << 0)
uint32_t PIO_Configure(Pio* port, EPioType type, uint32_t mask, uint32_t attribute);
uint32_t pmc_enable_periph_clk(uint32_t id);

// variant
#define PWM_INTERFACE_ID 36
typedef struct {
  Pio* pPort;
  uint32_t ulPin;
} PinDescription;
extern const PinDescription g_APinDescription[];

// wiring
void pinMode(uint32_t pin, uint32_t mode);
void delay(uint32_t ms);
void delayMicroseconds(uint32_t us);
void attachInterrupt(uint32_t pin, void (*callback)(void), uint32_t mode);

}  // extern "C"

void watchdogSetup(void);

// USB/USBDesc.h: the endpoints after the control and the interrupt endpoint
#define CDC_RX 2
#define CDC_TX 3

class Serial_ {
 public:
  bool dtr();
};
extern Serial_ SerialUSB;

#include <stddef.h>

#endif
