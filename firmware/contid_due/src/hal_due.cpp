// Hardware layer of the Arduino Due: every register access and every Arduino call is in this file.
//
// Interrupts, by priority: 0 encoder edges (PIOD), 1 the control tick (TC3) with the watchdog, 3 ports (UOTGHS,
// UART). A port that spins inside its own interrupt or in loop() cannot delay the tick.
#ifdef ARDUINO_ARCH_SAM

#include "hal_due.h"

#include <Arduino.h>

#include "core/link.h"
#include "core/quadrature.h"
#include "pins.h"

namespace {

using contid::CHANNELS;
using contid::Drive;
using contid::PINS;

const uint32_t PWM_PERIOD = VARIANT_MCK / 20000;  // 20 kHz: 4200 steps, 12 bit
const uint32_t WATCHDOG_MS = 250;
const uint32_t WRITE_TIMEOUT_MS = 50;
const uint32_t NATIVE_PACKET = 512;
const uint32_t PROGRAMMING_BAUD = 250000;  // exact on both chips of the programming port

contid::Board board;
contid::Role role;
contid::Inputs inputs;
contid::Outputs outputs;
contid::Quadrature decoder[4];

// ---- encoders ----

template <uint8_t N> uint32_t levels() { return (PIOD->PIO_PDSR >> contid::EDGE_PINS[N].shift) & 3u; }

template <uint8_t N> void on_edge() { decoder[N].edge(levels<N>()); }

template <uint8_t N> void start_edge_decoder() {
  pinMode(contid::EDGE_PINS[N].a, INPUT_PULLUP);
  pinMode(contid::EDGE_PINS[N].b, INPUT_PULLUP);
  decoder[N].start(levels<N>());
  attachInterrupt(contid::EDGE_PINS[N].a, on_edge<N>, CHANGE);
  attachInterrupt(contid::EDGE_PINS[N].b, on_edge<N>, CHANGE);
}

// Counts every edge of both tracks of TIOA and TIOB of the block's first channel.
void start_hardware_decoder(Tc* block, uint32_t id, uint32_t pin_a, uint32_t pin_b) {
  pmc_enable_periph_clk(id);
  PIO_Configure(g_APinDescription[pin_a].pPort, PIO_PERIPH_B, g_APinDescription[pin_a].ulPin, PIO_PULLUP);
  PIO_Configure(g_APinDescription[pin_b].pPort, PIO_PERIPH_B, g_APinDescription[pin_b].ulPin, PIO_PULLUP);
  block->TC_CHANNEL[0].TC_CMR = TC_CMR_TCCLKS_XC0;
  block->TC_BMR = TC_BMR_QDEN | TC_BMR_POSEN | TC_BMR_EDGPHA;
  block->TC_CHANNEL[0].TC_CCR = TC_CCR_CLKEN | TC_CCR_SWTRG;
}

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

void start_pwm() {
  pmc_enable_periph_clk(PWM_INTERFACE_ID);
  PWMC_ConfigureClocks(VARIANT_MCK, 0, VARIANT_MCK);
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const uint32_t unit = PINS[i].pwm_channel;
    PWMC_ConfigureChannel(PWM_INTERFACE, unit, PWM_CMR_CPRE_CLKA, 0, 0);
    PWMC_SetPeriod(PWM_INTERFACE, unit, static_cast<uint16_t>(PWM_PERIOD));
    PWMC_SetDutyCycle(PWM_INTERFACE, unit, 0);
    PWMC_EnableChannel(PWM_INTERFACE, unit);
    PIO_Configure(g_APinDescription[PINS[i].pwm].pPort, PIO_PERIPH_B, g_APinDescription[PINS[i].pwm].ulPin,
                  PIO_DEFAULT);
  }
}

void put_out(uint8_t i, const contid::Output& out) {
  if (role == contid::Role::PRESSURE) {
    set_pwm(i, out.drive == Drive::RUN ? steps_of(out.duty) : 0);
    return;
  }
  const bool brake = out.drive == Drive::BRAKE;
  const bool forward = out.drive == Drive::RUN && out.duty >= 0;
  const bool backward = out.drive == Drive::RUN && out.duty < 0;
  set_pin(PINS[i].in_a, forward || brake);
  set_pin(PINS[i].in_b, backward || brake);
  if (out.drive == Drive::RUN) {
    set_pwm(i, steps_of(out.duty));
  } else {
    set_pwm(i, brake || contid::COAST_WITH_PWM_HIGH ? PWM_PERIOD : 0);
  }
}

// Low from the moment it is driven. pinMode() would make it high first, whatever was written to it before.
void start_direction(uint8_t pin) {
  PIO_Configure(g_APinDescription[pin].pPort, PIO_OUTPUT_0, g_APinDescription[pin].ulPin, PIO_DEFAULT);
}

// ---- the control tick ----

void start_tick() {
  pmc_enable_periph_clk(ID_TC3);
  TC_Configure(TC1, 0, TC_CMR_WAVE | TC_CMR_WAVSEL_UP_RC | TC_CMR_TCCLKS_TIMER_CLOCK1);
  TC_SetRC(TC1, 0, VARIANT_MCK / 2 / contid::TICK_HZ);
  TC1->TC_CHANNEL[0].TC_IER = TC_IER_CPCS;
  TC1->TC_CHANNEL[0].TC_IDR = ~TC_IER_CPCS;
  NVIC_SetPriority(TC3_IRQn, 1);
  NVIC_SetPriority(UOTGHS_IRQn, 3);
  NVIC_SetPriority(UART_IRQn, 3);
  NVIC_ClearPendingIRQ(TC3_IRQn);
  NVIC_EnableIRQ(TC3_IRQn);
  TC_Start(TC1, 0);
}

void read_inputs() {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    // Conversions finished since the last tick; the tick never waits for one.
    inputs.analog[i] = static_cast<int32_t>(ADC->ADC_CDR[PINS[i].adc_channel] & 0xFFFu);
  }
  ADC->ADC_CR = ADC_CR_START;
  if (role != contid::Role::MOTOR) return;
  inputs.count[0] = static_cast<int32_t>(TC0->TC_CHANNEL[0].TC_CV);
  inputs.count[1] = static_cast<int32_t>(TC2->TC_CHANNEL[0].TC_CV);
  for (uint8_t i = 0; i < 4; ++i) inputs.count[contid::FIRST_EDGE_CHANNEL + i] = decoder[i].count;
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

// ---- ports ----

// An answer waits here until its port takes it. A port that takes nothing loses the answer; it never stops loop().
struct Port {
  contid::Link link;
  const uint8_t* waiting;
  size_t left;
  uint32_t since_ms;

  void start() {
    link.start();
    left = 0;
  }
  void answer(size_t size) {
    waiting = link.reply();
    left = size;
    since_ms = millis();
  }
  void took(size_t size) {
    waiting += size;
    left -= size;
  }
  void give_up_in_time() {
    if (left == 0 || millis() - since_ms < WRITE_TIMEOUT_MS) return;
    left = 0;
    board.count_dropped_answer();
  }
};

Port native;
Port programming;

// SerialUSB.availableForWrite() is always true; only the endpoint's register shows a free bank, with which a packet
// of up to 512 bytes goes out without waiting.
bool native_has_room() { return SerialUSB.dtr() && (UOTGHS->UOTGHS_DEVEPTISR[CDC_TX] & UOTGHS_DEVEPTISR_TXINI) != 0; }

void serve_native() {
  if (native.left > 0 && native_has_room()) {
    const size_t size = native.left < NATIVE_PACKET ? native.left : NATIVE_PACKET;
    SerialUSB.write(native.waiting, size);
    native.took(size);
  }
  native.give_up_in_time();
  while (native.left == 0 && SerialUSB.available() > 0) {
    native.answer(native.link.take(static_cast<uint8_t>(SerialUSB.read()), board));
  }
}

void serve_programming() {
  while (programming.left > 0 && Serial.availableForWrite() > 0) {
    Serial.write(*programming.waiting);
    programming.took(1);
  }
  programming.give_up_in_time();
  while (programming.left == 0 && Serial.available() > 0) {
    programming.answer(programming.link.take(static_cast<uint8_t>(Serial.read()), board));
  }
}

contid::ResetCause reset_cause() {
  if ((SUPC->SUPC_SR & SUPC_SR_BODRSTS) != 0) return contid::ResetCause::BROWN_OUT;
  const uint32_t type = (RSTC->RSTC_SR & RSTC_SR_RSTTYP_Msk) >> RSTC_SR_RSTTYP_Pos;
  return type <= 4 ? static_cast<contid::ResetCause>(type) : contid::ResetCause::POWER_UP;
}

uint8_t capabilities(uint8_t channel) {
  if (role == contid::Role::PRESSURE) return contid::READ_BACK;
  const uint8_t encoder = channel < contid::FIRST_EDGE_CHANNEL ? contid::HARDWARE_DECODER : contid::EDGE_DECODER;
  return static_cast<uint8_t>(encoder | contid::CURRENT_SENSE | contid::BRIDGE_FAULT);
}

}  // namespace

// main() calls it before setup(); the version of the Arduino core disables the watchdog until the next reset.
void watchdogSetup(void) { watchdogEnable(WATCHDOG_MS); }

extern "C" void TC3_Handler(void) {
  TC_GetStatus(TC1, 0);
  read_inputs();
  board.tick(inputs, outputs);
  for (uint8_t i = 0; i < CHANNELS; ++i) put_out(i, outputs.channel[i]);
}

void contid_setup() {
  pinMode(contid::ROLE_JUMPER, INPUT_PULLUP);
  delayMicroseconds(50);
  role = digitalRead(contid::ROLE_JUMPER) == LOW ? contid::Role::PRESSURE : contid::Role::MOTOR;

  contid::Identity identity = contid::Identity();
  identity.role = role;
  // A backup register: survives resets, not the loss of power.
  GPBR->SYS_GPBR[0] = GPBR->SYS_GPBR[0] + 1;
  identity.boot = static_cast<uint16_t>(GPBR->SYS_GPBR[0]);
  identity.cause = reset_cause();
  for (uint8_t i = 0; i < CHANNELS; ++i) identity.capabilities[i] = capabilities(i);
  identity.pins = role == contid::Role::MOTOR ? contid::MOTOR_PINS : contid::PRESSURE_PINS;
  board.start(identity, mask_tick, unmask_tick);
  native.start();
  programming.start();

  // First the outputs that drive bridges and valves.
  start_pwm();
  uint32_t adc_channels = 0;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    adc_channels |= 1u << PINS[i].adc_channel;
    if (role != contid::Role::MOTOR) continue;
    start_direction(PINS[i].in_a);
    start_direction(PINS[i].in_b);
    pinMode(PINS[i].fault, INPUT_PULLUP);
  }
  ADC->ADC_CHER = adc_channels;
  ADC->ADC_CR = ADC_CR_START;
  if (role == contid::Role::MOTOR) {
    start_hardware_decoder(TC0, ID_TC0, 2, 13);
    start_hardware_decoder(TC2, ID_TC6, 5, 4);
    start_edge_decoder<0>();
    start_edge_decoder<1>();
    start_edge_decoder<2>();
    start_edge_decoder<3>();
  }
  delay(1);  // the first conversions
  start_tick();
  // No answers before the first tick, whose inputs the first telemetry contains.
  while (board.uptime_ms() == 0) {
  }
  Serial.begin(PROGRAMMING_BAUD);
  SerialUSB.begin(0);
}

void contid_loop() {
  static uint32_t fed_at = 0;
  serve_native();
  serve_programming();
  // The watchdog is fed by a loop that runs while ticks run: either of them missing resets the board.
  const uint32_t now = board.uptime_ms();
  if (now != fed_at) {
    fed_at = now;
    watchdogReset();
  }
}

#endif  // ARDUINO_ARCH_SAM
