// Hardware layer of the Arduino Due: outputs, the control tick, start and watchdog. Encoders, ports and identity have
// files of their own in this folder; register accesses and Arduino calls are in the folders of boards only.
//
// Registers are written directly where the core's library (libsam) asserts or has side effects: its
// PWMC_ConfigureClocks() asserts for a clock of MCK, its PWMC_ConfigureChannel() overwrites the mode of channel 0.
//
// Interrupts, by priority: 0 encoder edges (PIOD), 1 the control tick (TC3) with the watchdog of the host, 3 USB
// control transfers (UOTGHS). Nothing else interrupts but SysTick (15).
#ifdef ARDUINO_ARCH_SAM

#include "../hal.h"

#include <Arduino.h>

#include "../converter.h"
#include "../core/board.h"
#include "../core/bridge.h"
#include "encoders.h"
#include "identity.h"
#include "pins.h"
#include "ports.h"

namespace {

using contid::CHANNELS;
using contid::Drive;
using contid::PINS;

const uint32_t PWM_PERIOD = VARIANT_MCK / 20000;  // 20 kHz: 4200 steps, 12 bit
// 8 periods of 128 slow clocks: 31 ms; 23 to 51 ms over the tolerance of the RC oscillator (20 to 44 kHz).
const uint32_t WATCHDOG_PERIODS = 8;
const uint32_t TIMER_PER_US = VARIANT_MCK / 2 / 1000000;  // counts of the tick's timer
const uint16_t ADC_STEPS = 4095, ADC_MV = 3300;
const uint32_t PULSE_NOPS = 12;  // with the accesses more than 0.2 us

contid::Board board;
contid::Role role;
contid::Inputs inputs;
contid::Outputs outputs;

// ---- outputs ----

void set_pin(uint8_t pin, bool high) {
  Pio* const port = g_APinDescription[pin].pPort;
  if (high) {
    port->PIO_SODR = g_APinDescription[pin].ulPin;
  } else {
    port->PIO_CODR = g_APinDescription[pin].ulPin;
  }
}

void set_pwm(uint8_t channel, uint32_t steps) { PWM->PWM_CH_NUM[PINS[channel].pwm_channel].PWM_CDTYUPD = steps; }

uint32_t steps_of(int32_t duty) {
  const uint32_t magnitude = static_cast<uint32_t>(duty < 0 ? -duty : duty);
  return magnitude * PWM_PERIOD / static_cast<uint32_t>(contid::DUTY_FULL);
}

// Every channel counts MCK itself, left-aligned; its low output (PWML) is high for CDTY steps of CPRD.
void start_pwm() {
  pmc_enable_periph_clk(PWM_INTERFACE_ID);
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const uint32_t unit = PINS[i].pwm_channel;
    // A running channel takes its mode and period only when it has stopped, at the end of its period.
    PWM->PWM_DIS = 1u << unit;
    while ((PWM->PWM_SR & (1u << unit)) != 0) {
    }
    PWM->PWM_CH_NUM[unit].PWM_CMR = PWM_CMR_CPRE_MCK;
    PWM->PWM_CH_NUM[unit].PWM_CPRD = PWM_PERIOD;
    PWM->PWM_CH_NUM[unit].PWM_CDTY = 0;
    PWM->PWM_ENA = 1u << unit;
    PIO_Configure(g_APinDescription[PINS[i].pwm].pPort, PIO_PERIPH_B, g_APinDescription[PINS[i].pwm].ulPin,
                  PIO_DEFAULT);
  }
}

// An input without pull-up: the resistors of the wiring give the level.
void release(uint8_t pin) {
  Pio* const port = g_APinDescription[pin].pPort;
  const uint32_t mask = g_APinDescription[pin].ulPin;
  port->PIO_ODR = mask;
  port->PIO_PUDR = mask;
  port->PIO_PER = mask;
}

void drive_lines(uint8_t i, bool driven) {
  if (!driven) {
    release(PINS[i].pwm);
    release(PINS[i].in_a);
    release(PINS[i].in_b);
    return;
  }
  const PinDescription& a = g_APinDescription[PINS[i].in_a];
  const PinDescription& b = g_APinDescription[PINS[i].in_b];
  const PinDescription& pwm = g_APinDescription[PINS[i].pwm];
  a.pPort->PIO_OER = a.ulPin;
  b.pPort->PIO_OER = b.ulPin;
  pwm.pPort->PIO_PDR = pwm.ulPin;  // to the PWM unit, which drives it
}

// Valves without an order have no power: the pull-downs at their transistors keep them so.
void put_valves(uint8_t i, const contid::Output& out) {
  if (out.drive != Drive::VALVES) {
    release(PINS[i].in_a);
    release(PINS[i].in_b);
    return;
  }
  const PinDescription& inlet = g_APinDescription[PINS[i].in_a];
  const PinDescription& outlet = g_APinDescription[PINS[i].in_b];
  set_pin(PINS[i].in_a, (out.duty & 1) != 0);
  set_pin(PINS[i].in_b, (out.duty & 2) != 0);
  inlet.pPort->PIO_OER = inlet.ulPin;
  outlet.pPort->PIO_OER = outlet.ulPin;
}

void put_out(uint8_t i, const contid::Output& out) {
  if (role == contid::Role::PRESSURE) {
    put_valves(i, out);
    set_pwm(i, out.drive == Drive::RUN ? steps_of(out.duty) : 0);
    return;
  }
  const contid::Lines lines = contid::bridge_lines(board.bridge(i), out);
  set_pin(PINS[i].in_a, lines.in_a);
  set_pin(PINS[i].in_b, lines.in_b);
  set_pwm(i, steps_of(lines.pwm));
  drive_lines(i, lines.driven);
}

// ---- the control tick ----

void start_tick() {
  TcChannel& timer = TC1->TC_CHANNEL[0];
  pmc_enable_periph_clk(ID_TC3);
  timer.TC_CCR = TC_CCR_CLKDIS;
  timer.TC_IDR = 0xFFFFFFFFu;
  timer.TC_CMR = TC_CMR_WAVE | TC_CMR_WAVSEL_UP_RC | TC_CMR_TCCLKS_TIMER_CLOCK1;
  timer.TC_RC = VARIANT_MCK / 2 / contid::TICK_HZ;
  timer.TC_IER = TC_IER_CPCS;
  NVIC_SetPriority(TC3_IRQn, 1);
  NVIC_SetPriority(UOTGHS_IRQn, 3);
  NVIC_ClearPendingIRQ(TC3_IRQn);
  NVIC_EnableIRQ(TC3_IRQn);
  timer.TC_CCR = TC_CCR_CLKEN | TC_CCR_SWTRG;
}

// Time since the newest tick. A tick that waits behind the mask is not counted by the board yet.
uint32_t since_tick_us() {
  bool waits = false;
  uint32_t count = 0;
  do {
    waits = NVIC_GetPendingIRQ(TC3_IRQn) != 0;
    count = TC1->TC_CHANNEL[0].TC_CV;
  } while (waits != (NVIC_GetPendingIRQ(TC3_IRQn) != 0));
  return count / TIMER_PER_US + (waits ? 1000000 / contid::TICK_HZ : 0);
}

// The chip measures VDDUTMI, which the board connects to its 3.3 V; the readings of the ADC scale with them.
void start_supply_monitor() { SUPC->SUPC_SMMR = SUPC_SMMR_SMTH_3_0V | SUPC_SMMR_SMSMPL_CSM; }

// The lines of the converter of a load cell.
struct CellLines {
  uint8_t channel;

  bool data() const {
    const PinDescription& pin = g_APinDescription[contid::CELL_PINS[channel].data];
    return (pin.pPort->PIO_PDSR & pin.ulPin) != 0;
  }
  void clock(bool high) const {
    set_pin(contid::CELL_PINS[channel].clock, high);
    for (uint32_t i = 0; i < PULSE_NOPS; ++i) __asm__ volatile("nop");
  }
  void start() const {
    const PinDescription& pin = g_APinDescription[contid::CELL_PINS[channel].clock];
    set_pin(contid::CELL_PINS[channel].clock, false);
    pin.pPort->PIO_OER = pin.ulPin;
    pin.pPort->PIO_PER = pin.ulPin;
  }
};

// One converter a tick: 25 pulses take 30 us.
void read_cells() {
  static uint8_t next = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    inputs.cell_analog[i] = static_cast<int32_t>(ADC->ADC_CDR[contid::CELL_PINS[i].adc_channel] & 0xFFFu);
  }
  inputs.cell_fresh = 0;
  for (uint8_t tries = 0; tries < CHANNELS && inputs.cell_fresh == 0; ++tries) {
    const uint8_t i = next;
    next = static_cast<uint8_t>((next + 1) % CHANNELS);
    const CellLines lines = {i};
    if (!board.converts(i)) continue;
    lines.start();
    if (contid::read_converter(lines, inputs.cell_steps[i])) inputs.cell_fresh = static_cast<uint8_t>(1u << i);
  }
}

void read_inputs() {
  // Reading it clears the bit.
  inputs.supply_low = (SUPC->SUPC_SR & SUPC_SR_SMS) != 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    // Conversions finished since the last tick; the tick never waits for one.
    inputs.analog[i] = static_cast<int32_t>(ADC->ADC_CDR[PINS[i].adc_channel] & 0xFFFu);
  }
  if (role == contid::Role::MOTOR) read_cells();
  ADC->ADC_CR = ADC_CR_START;
  if (role != contid::Role::MOTOR) return;
  contid::read_encoders(inputs.count, inputs.missed);
  contid::read_edges(inputs.edges_a, inputs.edges_b);
  uint8_t faults = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const PinDescription& pin = g_APinDescription[PINS[i].fault];
    if ((pin.pPort->PIO_PDSR & pin.ulPin) == 0) faults = static_cast<uint8_t>(faults | (1u << i));
  }
  inputs.bridge_faults = faults;
}

void mask_tick() {
  NVIC_DisableIRQ(TC3_IRQn);
  // The interrupt must be off before the next instruction changes what it reads.
  __DSB();
  __ISB();
}

void unmask_tick() { NVIC_EnableIRQ(TC3_IRQn); }

// ---- start ----

uint8_t capabilities(uint8_t channel) {
  if (role == contid::Role::PRESSURE) return contid::READ_BACK | contid::VALVE_PAIR;
  const uint8_t encoder = channel < contid::FIRST_EDGE_CHANNEL ? contid::HARDWARE_DECODER : contid::EDGE_DECODER;
  return static_cast<uint8_t>(encoder | contid::CURRENT_SENSE | contid::BRIDGE_FAULT | contid::CELL_ANALOG |
                              contid::CELL_CONVERTER);
}

contid::Role read_role() {
  pinMode(contid::ROLE_JUMPER, INPUT_PULLUP);
  delayMicroseconds(50);
  const PinDescription& jumper = g_APinDescription[contid::ROLE_JUMPER];
  return (jumper.pPort->PIO_PDSR & jumper.ulPin) == 0 ? contid::Role::PRESSURE : contid::Role::MOTOR;
}

}  // namespace

// main() calls it before setup(); the version of the Arduino core disables the watchdog until the next reset.
void watchdogSetup(void) { WDT->WDT_MR = WDT_MR_WDRSTEN | WDT_MR_WDV(WATCHDOG_PERIODS) | WDT_MR_WDD(WATCHDOG_PERIODS); }

extern "C" void TC3_Handler(void) {
  (void)TC1->TC_CHANNEL[0].TC_SR;  // reading it ends the request
  read_inputs();
  board.tick(inputs, outputs);
  for (uint8_t i = 0; i < CHANNELS; ++i) put_out(i, outputs.channel[i]);
}

void contid_setup() {
  role = read_role();
  contid::Identity identity = contid::Identity();
  identity.role = role;
  contid::read_identity(identity);
  contid::number_usb(identity);  // the core has attached; a host waits 100 ms before it asks
  for (uint8_t i = 0; i < CHANNELS; ++i) identity.capabilities[i] = capabilities(i);
  identity.bridges = role == contid::Role::MOTOR ? contid::ALL_BRIDGES : 0;
  identity.adc_steps = ADC_STEPS;
  identity.adc_mv = ADC_MV;
  identity.pins = role == contid::Role::MOTOR ? contid::MOTOR_PINS : contid::PRESSURE_PINS;
  board.start(identity, mask_tick, unmask_tick);
  board.clock(since_tick_us);
  start_supply_monitor();

  // First the outputs that drive bridges and valves.
  start_pwm();
  uint32_t adc_channels = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    adc_channels |= 1u << PINS[i].adc_channel;
    if (role != contid::Role::MOTOR) continue;
    adc_channels |= 1u << contid::CELL_PINS[i].adc_channel;
    drive_lines(i, false);
    pinMode(PINS[i].fault, INPUT_PULLUP);
    pinMode(contid::CELL_PINS[i].data, INPUT_PULLUP);
  }
  ADC->ADC_CHER = adc_channels;
  ADC->ADC_CR = ADC_CR_START;
  if (role == contid::Role::MOTOR) contid::start_encoders();
  delay(1);  // the first conversions
  start_tick();
  // No answers before the first tick, whose inputs the first telemetry contains.
  while (board.uptime_ms() == 0) {
  }
  contid::start_ports();
}

void contid_loop() {
  static uint32_t fed_at = 0;
  static uint8_t configured = 0;
  contid::serve_ports(board);
  if (role == contid::Role::MOTOR && board.configured() != configured) {
    configured = board.configured();
    contid::use_encoders(configured);
  }
  // The watchdog is fed by a loop that runs while ticks run: either of them missing resets the board.
  const uint32_t now = board.uptime_ms();
  if (now != fed_at) {
    fed_at = now;
    WDT->WDT_CR = WDT_CR_KEY(0xA5) | WDT_CR_WDRSTT;
  }
}

#endif  // ARDUINO_ARCH_SAM
