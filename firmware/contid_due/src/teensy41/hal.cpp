// Hardware layer of a Teensy 4.1: outputs, the control tick, start, watchdog and the USB port.
//
// Compiled and linked with the Teensy core, its set-up and tick run on an emulated Cortex-M7 (tests/firmware/teensy41);
// it has not run on a board.
//
// Interrupts, by priority: 16 the control tick (PIT), 32 SysTick, 64 conversions (ADC1), 128 USB.
#ifdef ARDUINO_TEENSY41

#include "../hal.h"

#include <Arduino.h>
#include <IntervalTimer.h>

#include "../converter.h"
#include "../core/board.h"
#include "../core/bridge.h"
#include "../port.h"
#include "encoders.h"
#include "identity.h"
#include "pins.h"

namespace {

using contid::BRIDGE_PINS;
using contid::CHANNELS;
using contid::Drive;
using contid::MOTORS;
using contid::PWM_PINS;

const uint32_t PWM_HZ = 20000;
const uint8_t TICK_PRIORITY = 16, ADC_PRIORITY = 64;
const uint16_t ADC_STEPS = 4095, ADC_MV = 3300;
// Watchdog 3 counts a clock of 32.768 kHz: 31 ms.
const uint32_t WATCHDOG_PERIODS = 1016;
const uint32_t WATCHDOG_UNLOCK = 0xD928C520, WATCHDOG_REFRESH = 0xB480A602;
// WDOG3_CS: 32 bit commands, the slow clock, enabled; no update until the next reset.
const uint32_t WATCHDOG_MODE = 1u << 13 | 1u << 8 | 1u << 7;
const uint32_t WATCHDOG_UNLOCKED = 1u << 11;  // WDOG3_CS.ULK
const uint32_t WATCHDOG_TRIES = 100000;

contid::Board board;
contid::Role role;
contid::Inputs inputs;
contid::Outputs outputs;
contid::Port port;
IntervalTimer timer;
volatile uint32_t tick_cycles;
volatile uint16_t readings[CHANNELS + MOTORS];  // behind those of the channels, those of their load cells
volatile uint8_t converting;

// ---- outputs ----

IMXRT_FLEXPWM_t& pwm_unit(uint8_t channel) { return PWM_PINS[channel].unit == 2 ? IMXRT_FLEXPWM2 : IMXRT_FLEXPWM3; }

void set_pwm(uint8_t channel, int32_t duty) {
  IMXRT_FLEXPWM_t& unit = pwm_unit(channel);
  const uint8_t sub = PWM_PINS[channel].submodule;
  const uint32_t magnitude = static_cast<uint32_t>(duty < 0 ? -duty : duty);
  const uint32_t period = static_cast<uint32_t>(unit.SM[sub].VAL1) + 1;
  const uint16_t steps = static_cast<uint16_t>(magnitude * period / static_cast<uint32_t>(contid::DUTY_FULL));
  const uint16_t mask = static_cast<uint16_t>(1u << sub);
  // The values take effect together, at the end of a period.
  unit.MCTRL |= FLEXPWM_MCTRL_CLDOK(mask);
  if (PWM_PINS[channel].b) {
    unit.SM[sub].VAL5 = steps;
  } else {
    unit.SM[sub].VAL3 = steps;
  }
  unit.MCTRL |= FLEXPWM_MCTRL_LDOK(mask);
}

void start_pwm() {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    IMXRT_FLEXPWM_t& unit = pwm_unit(i);
    const uint16_t mask = static_cast<uint16_t>(1u << PWM_PINS[i].submodule);
    analogWriteFrequency(PWM_PINS[i].pin, PWM_HZ);
    set_pwm(i, 0);
    unit.OUTEN |= PWM_PINS[i].b ? FLEXPWM_OUTEN_PWMB_EN(mask) : FLEXPWM_OUTEN_PWMA_EN(mask);
    if (role == contid::Role::PRESSURE) *portConfigRegister(PWM_PINS[i].pin) = PWM_PINS[i].alternate;
  }
}

// An input without pull-up or keeper: the resistors of the wiring give the level.
void release(uint8_t pin) { pinMode(pin, INPUT); }

void set_pin(uint8_t pin, bool high) {
  if (high) {
    *portSetRegister(pin) = digitalPinToBitMask(pin);
  } else {
    *portClearRegister(pin) = digitalPinToBitMask(pin);
  }
}

void drive_lines(uint8_t i, bool driven) {
  if (!driven) {
    release(PWM_PINS[i].pin);
    release(BRIDGE_PINS[i].in_a);
    release(BRIDGE_PINS[i].in_b);
    return;
  }
  *portModeRegister(BRIDGE_PINS[i].in_a) |= digitalPinToBitMask(BRIDGE_PINS[i].in_a);
  *portModeRegister(BRIDGE_PINS[i].in_b) |= digitalPinToBitMask(BRIDGE_PINS[i].in_b);
  *portConfigRegister(PWM_PINS[i].pin) = PWM_PINS[i].alternate;  // to the PWM unit, which drives it
}

// Valves without an order have no power: the pull-downs at their transistors keep them so.
void put_valves(uint8_t i, const contid::Output& out) {
  const uint8_t pins[] = {BRIDGE_PINS[i].in_a, BRIDGE_PINS[i].in_b};
  for (int32_t line = 0; line < 2; ++line) {
    if (out.drive != Drive::VALVES) {
      release(pins[line]);
      continue;
    }
    set_pin(pins[line], (out.duty >> line & 1) != 0);
    *portModeRegister(pins[line]) |= digitalPinToBitMask(pins[line]);
  }
}

void put_out(uint8_t i, const contid::Output& out) {
  if (role == contid::Role::PRESSURE) {
    if (i < MOTORS) put_valves(i, out);
    set_pwm(i, out.drive == Drive::RUN ? out.duty : 0);
    return;
  }
  if (i >= MOTORS) return;
  const contid::Lines lines = contid::bridge_lines(board.bridge(i), out);
  set_pin(BRIDGE_PINS[i].in_a, lines.in_a);
  set_pin(BRIDGE_PINS[i].in_b, lines.in_b);
  set_pwm(i, lines.pwm);
  drive_lines(i, lines.driven);
}

// ---- inputs ----

uint8_t conversions() { return role == contid::Role::MOTOR ? CHANNELS + MOTORS : CHANNELS; }

// Each conversion starts the next one; the tick starts the first, and never waits.
void convert(uint8_t i) {
  converting = i;
  ADC1_HC0 = ADC_HC_AIEN | (i < CHANNELS ? contid::ADC_CHANNELS[i] : contid::CELL_ADC_CHANNELS[i - CHANNELS]);
}

void on_conversion() {
  const uint8_t i = converting;
  readings[i] = static_cast<uint16_t>(ADC1_R0);  // reading it ends the request
  if (i + 1 < conversions()) convert(static_cast<uint8_t>(i + 1));
}

void start_conversions() {
  analogReadRes(12);
  for (uint8_t i = 0; i < CHANNELS; ++i) readings[i] = static_cast<uint16_t>(analogRead(contid::ANALOG_PINS[i]));
  for (uint8_t i = 0; i < MOTORS && role == contid::Role::MOTOR; ++i) {
    readings[CHANNELS + i] = static_cast<uint16_t>(analogRead(contid::CELL_PINS[i]));
  }
  converting = static_cast<uint8_t>(conversions() - 1);
  attachInterruptVector(IRQ_ADC1, on_conversion);
  NVIC_SET_PRIORITY(IRQ_ADC1, ADC_PRIORITY);
  NVIC_ENABLE_IRQ(IRQ_ADC1);
}

// The lines of the converter of a load cell.
struct CellLines {
  uint8_t channel;

  bool data() const {
    const uint8_t pin = contid::CELL_PINS[channel];
    return (*portInputRegister(pin) & digitalPinToBitMask(pin)) != 0;
  }
  void clock(bool high) const {
    set_pin(contid::CELL_CLOCKS[channel], high);
    delayNanoseconds(250);
  }
};

// One converter a tick: 25 pulses take 15 us.
void read_cells() {
  static uint8_t next = 0, driven = 0;
  for (uint8_t i = 0; i < MOTORS; ++i) inputs.cell_analog[i] = readings[CHANNELS + i];
  inputs.cell_fresh = 0;
  for (uint8_t tries = 0; tries < MOTORS && inputs.cell_fresh == 0; ++tries) {
    const uint8_t i = next;
    next = static_cast<uint8_t>((next + 1) % MOTORS);
    if (!board.converts(i)) continue;
    const CellLines lines = {i};
    if ((driven >> i & 1) == 0) {
      driven = static_cast<uint8_t>(driven | 1u << i);
      set_pin(contid::CELL_CLOCKS[i], false);
      pinMode(contid::CELL_CLOCKS[i], OUTPUT);
    }
    if (contid::read_converter(lines, inputs.cell_steps[i])) inputs.cell_fresh = static_cast<uint8_t>(1u << i);
  }
}

void read_inputs() {
  for (uint8_t i = 0; i < CHANNELS; ++i) inputs.analog[i] = readings[i];
  if (role == contid::Role::MOTOR) read_cells();
  if (converting == conversions() - 1) convert(0);
  if (role != contid::Role::MOTOR) return;
  contid::read_encoders(inputs.count, inputs.missed);
  contid::read_edges(inputs.edges_a, inputs.edges_b);
  uint8_t faults = 0;
  for (uint8_t i = 0; i < MOTORS; ++i) {
    const uint8_t pin = BRIDGE_PINS[i].fault;
    if ((*portInputRegister(pin) & digitalPinToBitMask(pin)) == 0) faults = static_cast<uint8_t>(faults | (1u << i));
  }
  inputs.bridge_faults = faults;
}

// ---- the control tick ----

void tick() {
  tick_cycles = ARM_DWT_CYCCNT;
  read_inputs();
  board.tick(inputs, outputs);
  for (uint8_t i = 0; i < CHANNELS; ++i) put_out(i, outputs.channel[i]);
}

uint32_t since_tick_us() { return (ARM_DWT_CYCCNT - tick_cycles) / (F_CPU_ACTUAL / 1000000); }

void mask_tick() {
  NVIC_DISABLE_IRQ(IRQ_PIT);
  // The interrupt must be off before the next instruction changes what it reads.
  asm volatile("dsb\n isb" ::: "memory");
}

void unmask_tick() { NVIC_ENABLE_IRQ(IRQ_PIT); }

// ---- start ----

uint8_t capabilities(uint8_t channel) {
  if (role == contid::Role::PRESSURE)
    return static_cast<uint8_t>(contid::READ_BACK | (channel < MOTORS ? contid::VALVE_PAIR : 0));
  if (channel >= MOTORS) return 0;
  return contid::HARDWARE_DECODER | contid::CURRENT_SENSE | contid::BRIDGE_FAULT | contid::CELL_ANALOG |
         contid::CELL_CONVERTER;
}

contid::Role read_role() {
  pinMode(contid::ROLE_JUMPER, INPUT_PULLUP);
  delayMicroseconds(50);
  const uint32_t mask = digitalPinToBitMask(contid::ROLE_JUMPER);
  return (*portInputRegister(contid::ROLE_JUMPER) & mask) == 0 ? contid::Role::PRESSURE : contid::Role::MOTOR;
}

// It cannot start before setup(): the core waits 300 ms for USB, longer than its period.
void start_watchdog() {
  CCM_CCGR5 |= CCM_CCGR5_WDOG3(CCM_CCGR_ON);
  __disable_irq();
  WDOG3_CNT = WATCHDOG_UNLOCK;
  for (uint32_t i = 0; i < WATCHDOG_TRIES && (WDOG3_CS & WATCHDOG_UNLOCKED) == 0; ++i) {
  }
  WDOG3_TOVAL = WATCHDOG_PERIODS;
  WDOG3_CS = WATCHDOG_MODE;
  __enable_irq();
}

void serve_port() {
  const uint8_t end = 0;
  if (port.torn && Serial.dtr() && Serial.availableForWrite() > 0) {
    Serial.write(&end, 1);
    Serial.send_now();
    port.torn = false;
  }
  if (port.left > 0 && !port.torn && Serial.dtr()) {
    const int room = Serial.availableForWrite();
    const size_t size = port.left < static_cast<size_t>(room) ? port.left : static_cast<size_t>(room);
    // Within the room a write does not wait.
    if (size > 0) port.took(Serial.write(port.waiting, size));
    if (size > 0 && port.left == 0) Serial.send_now();
  }
  port.drop_overdue(board);
  while (port.left == 0 && Serial.available() > 0) port.take(static_cast<uint8_t>(Serial.read()), board);
}

}  // namespace

void contid_setup() {
  role = read_role();
  contid::Identity identity = contid::Identity();
  identity.role = role;
  contid::read_identity(identity);
  for (uint8_t i = 0; i < CHANNELS; ++i) identity.capabilities[i] = capabilities(i);
  identity.bridges = role == contid::Role::MOTOR ? contid::ALL_BRIDGES : 0;
  identity.adc_steps = ADC_STEPS;
  identity.adc_mv = ADC_MV;
  identity.pins = role == contid::Role::MOTOR ? contid::MOTOR_PINS : contid::PRESSURE_PINS;
  board.start(identity, mask_tick, unmask_tick);
  board.clock(since_tick_us);

  // First the outputs that drive bridges and valves.
  start_pwm();
  if (role == contid::Role::MOTOR) {
    for (uint8_t i = 0; i < MOTORS; ++i) {
      drive_lines(i, false);
      pinMode(BRIDGE_PINS[i].fault, INPUT_PULLUP);
    }
    contid::start_encoders();
  }
  start_conversions();
  port.start();
  start_watchdog();
  tick();  // no answer without inputs
  timer.priority(TICK_PRIORITY);
  timer.begin(tick, 1000000 / contid::TICK_HZ);
}

void contid_loop() {
  static uint32_t fed_at = 0;
  serve_port();
  // The watchdog is fed by a loop that runs while ticks run: either of them missing resets the board.
  const uint32_t now = board.uptime_ms();
  if (now == fed_at) return;
  fed_at = now;
  WDOG3_CNT = WATCHDOG_REFRESH;
}

#endif  // ARDUINO_TEENSY41
