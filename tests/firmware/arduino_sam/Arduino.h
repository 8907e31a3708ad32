// Every name that hal_due.cpp may use of the Arduino SAM core, and nothing else: what is not here does not compile
// in the test, so a name that the Due's core lacks cannot creep in. Declarations only. Where each was read:
//   ArduinoCore-sam cores/arduino: Arduino.h, wiring*.h, WInterrupts.h, watchdog.h, UARTClass.h, USB/USBAPI.h,
//   USB/USBDesc.h, USB/CDC.cpp; variants/arduino_due_x/variant.{h,cpp}; wiring_analog.c (PWMC_*, TC_*, PIO_Configure)
//   CMSIS SAM3XA: component_{pio,tc,pwm,adc,uotghs,rstc,supc,gpbr}.h; core_cm3.h, core_cmInstr.h (NVIC_*, __DSB, __ISB)
#ifndef ARDUINO_SAM_NAMES_H
#define ARDUINO_SAM_NAMES_H

#include <stddef.h>
#include <stdint.h>

#define VARIANT_MCK 84000000

// Macros of the core that a careless name in our sources would collide with.
#define PI 3.1415926535897932
#define HALF_PI 1.5707963267948966
#define EULER 2.718281828459045
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define constrain(amt, low, high) ((amt) < (low) ? (low) : ((amt) > (high) ? (high) : (amt)))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x)-0.5))
#define radians(deg) ((deg)*0.017453292519943295)
#define degrees(rad) ((rad)*57.29577951308232)
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
#define lowByte(w) ((uint8_t)((w)&0xff))
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
void __DSB(void);
void __ISB(void);

typedef volatile uint32_t RwReg;
typedef volatile uint32_t WoReg;
typedef const volatile uint32_t RoReg;

typedef struct {
  WoReg PIO_SODR, PIO_CODR;
  RoReg PIO_PDSR;
} Pio;
typedef struct {
  WoReg TC_CCR, TC_IER, TC_IDR;
  RwReg TC_CMR;
  RoReg TC_CV;
} TcChannel;
typedef struct {
  TcChannel TC_CHANNEL[3];
  RwReg TC_BMR;
} Tc;
typedef struct {
  RwReg PWM_CDTYUPD;
} PwmCh_num;
typedef struct {
  PwmCh_num PWM_CH_NUM[8];
} Pwm;
typedef struct {
  WoReg ADC_CR, ADC_CHER;
  RoReg ADC_CDR[16];
} Adc;
typedef struct {
  RoReg UOTGHS_DEVEPTISR[10];
} Uotghs;
typedef struct {
  RoReg RSTC_SR;
} Rstc;
typedef struct {
  RoReg SUPC_SR;
} Supc;
typedef struct {
  RwReg SYS_GPBR[8];
} Gpbr;
extern Pio* const PIOD;
extern Tc* const TC0;
extern Tc* const TC1;
extern Tc* const TC2;
extern Pwm* const PWM;
extern Adc* const ADC;
extern Uotghs* const UOTGHS;
extern Rstc* const RSTC;
extern Supc* const SUPC;
extern Gpbr* const GPBR;

#define ID_TC0 27
#define ID_TC3 30
#define ID_TC6 33
#define TC_CMR_TCCLKS_TIMER_CLOCK1 (0x0u << 0)
#define TC_CMR_TCCLKS_XC0 (0x5u << 0)
#define TC_CMR_WAVE (0x1u << 15)
#define TC_CMR_WAVSEL_UP_RC (0x2u << 13)
#define TC_BMR_QDEN (0x1u << 8)
#define TC_BMR_POSEN (0x1u << 9)
#define TC_BMR_EDGPHA (0x1u << 12)
#define TC_CCR_CLKEN (0x1u << 0)
#define TC_CCR_SWTRG (0x1u << 2)
#define TC_IER_CPCS (0x1u << 4)
#define ADC_CR_START (0x1u << 1)
#define PWM_CMR_CPRE_CLKA (0xBu << 0)
#define UOTGHS_DEVEPTISR_TXINI (0x1u << 0)
#define RSTC_SR_RSTTYP_Pos 8
#define RSTC_SR_RSTTYP_Msk (0x7u << RSTC_SR_RSTTYP_Pos)
#define SUPC_SR_BODRSTS (0x1u << 3)

// libsam
typedef enum { PIO_PERIPH_B, PIO_INPUT, PIO_OUTPUT_0 } EPioType;
#define PIO_DEFAULT (0u << 0)
#define PIO_PULLUP (1u << 0)
uint32_t PIO_Configure(Pio* port, EPioType type, uint32_t mask, uint32_t attribute);
uint32_t pmc_enable_periph_clk(uint32_t id);
void TC_Configure(Tc* block, uint32_t channel, uint32_t mode);
void TC_SetRC(Tc* block, uint32_t channel, uint32_t value);
void TC_Start(Tc* block, uint32_t channel);
uint32_t TC_GetStatus(Tc* block, uint32_t channel);
void PWMC_ConfigureClocks(uint32_t clka, uint32_t clkb, uint32_t mck);
void PWMC_ConfigureChannel(Pwm* pwm, uint32_t channel, uint32_t prescaler, uint32_t alignment, uint32_t polarity);
void PWMC_SetPeriod(Pwm* pwm, uint32_t channel, uint16_t period);
void PWMC_SetDutyCycle(Pwm* pwm, uint32_t channel, uint16_t duty);
void PWMC_EnableChannel(Pwm* pwm, uint32_t channel);

// variant
#define PWM_INTERFACE PWM
#define PWM_INTERFACE_ID 36
typedef struct {
  Pio* pPort;
  uint32_t ulPin;
} PinDescription;
extern const PinDescription g_APinDescription[];

// wiring
void pinMode(uint32_t pin, uint32_t mode);
void digitalWrite(uint32_t pin, uint32_t value);
int digitalRead(uint32_t pin);
uint32_t millis(void);
void delay(uint32_t ms);
void delayMicroseconds(uint32_t us);
void attachInterrupt(uint32_t pin, void (*callback)(void), uint32_t mode);

}  // extern "C"

void watchdogEnable(uint32_t timeout);
void watchdogReset(void);
void watchdogSetup(void);

// USB/USBDesc.h: the third endpoint after the control endpoint
#define CDC_TX 3

class UARTClass {
 public:
  void begin(uint32_t baud);
  int available();
  int availableForWrite();
  int read();
  size_t write(uint8_t byte);
};
extern UARTClass Serial;

class Serial_ {
 public:
  void begin(uint32_t baud);
  int available();
  int read();
  size_t write(const uint8_t* buffer, size_t size);
  bool dtr();
};
extern Serial_ SerialUSB;

#endif
