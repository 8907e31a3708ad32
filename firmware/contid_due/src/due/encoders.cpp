// Encoders: two hardware decoders (TC0, TC2) and four in pin interrupts of port D.
//
// Every input is filtered. The decoders ignore pulses shorter than 64 MCK (0.76 us). The pin inputs are debounced
// with the slow clock: pulses below 30 us are ignored, and no input interrupts more often than 16 400 times per
// second, which also limits the time that noise takes. Edges of one encoder must be 61 us apart (16 400 per second;
// 10 000 at the slow clock's lower limit of 20 kHz).
#ifdef ARDUINO_ARCH_SAM

#include "encoders.h"

#include <Arduino.h>

#include "../core/quadrature.h"
#include "pins.h"

namespace contid {

namespace {

const uint8_t EDGE_CHANNELS = CHANNELS - FIRST_EDGE_CHANNEL;

Quadrature decoder[EDGE_CHANNELS];

// Pins of the hardware decoders, track A and track B, whose levels are sampled by the tick.
const uint8_t DECODER_PINS[FIRST_EDGE_CHANNEL][2] = {{2, 13}, {5, 4}};
TrackEdges sampled[FIRST_EDGE_CHANNEL];

uint32_t level(uint8_t pin) {
  const PinDescription& line = g_APinDescription[pin];
  return (line.pPort->PIO_PDSR & line.ulPin) != 0 ? 1u : 0u;
}

uint32_t decoder_levels(uint8_t channel) {
  return level(DECODER_PINS[channel][0]) << 1 | level(DECODER_PINS[channel][1]);
}

template <uint8_t N> uint32_t levels() { return (PIOD->PIO_PDSR >> EDGE_PINS[N].shift) & 3u; }

template <uint8_t N> void on_edge() { decoder[N].edge(levels<N>()); }

uint32_t pins_of(uint8_t n) { return 3u << EDGE_PINS[n].shift; }

template <uint8_t N> void start_edge_decoder() {
  pinMode(EDGE_PINS[N].a, INPUT_PULLUP);
  pinMode(EDGE_PINS[N].b, INPUT_PULLUP);
  PIOD->PIO_SCDR = 0;
  PIOD->PIO_DIFSR = pins_of(N);
  PIOD->PIO_IFER = pins_of(N);
  // Two periods of the filter, until its output follows its input.
  delayMicroseconds(200);
  decoder[N].start(levels<N>());
  attachInterrupt(EDGE_PINS[N].a, on_edge<N>, CHANGE);
  attachInterrupt(EDGE_PINS[N].b, on_edge<N>, CHANGE);
}

// Counts every edge of both tracks of TIOA and TIOB of the block's first channel.
void start_hardware_decoder(Tc* block, uint32_t id, uint32_t pin_a, uint32_t pin_b) {
  pmc_enable_periph_clk(id);
  PIO_Configure(g_APinDescription[pin_a].pPort, PIO_PERIPH_B, g_APinDescription[pin_a].ulPin, PIO_PULLUP);
  PIO_Configure(g_APinDescription[pin_b].pPort, PIO_PERIPH_B, g_APinDescription[pin_b].ulPin, PIO_PULLUP);
  block->TC_CHANNEL[0].TC_CMR = TC_CMR_TCCLKS_XC0;
  block->TC_BMR = TC_BMR_QDEN | TC_BMR_POSEN | TC_BMR_EDGPHA | TC_BMR_FILTER | TC_BMR_MAXFILT(63);
  block->TC_CHANNEL[0].TC_CCR = TC_CCR_CLKEN | TC_CCR_SWTRG;
}

}  // namespace

void start_encoders() {
  start_hardware_decoder(TC0, ID_TC0, DECODER_PINS[0][0], DECODER_PINS[0][1]);
  start_hardware_decoder(TC2, ID_TC6, DECODER_PINS[1][0], DECODER_PINS[1][1]);
  for (uint8_t i = 0; i < FIRST_EDGE_CHANNEL; ++i) sampled[i].start(decoder_levels(i));
  start_edge_decoder<0>();
  start_edge_decoder<1>();
  start_edge_decoder<2>();
  start_edge_decoder<3>();
}

void use_encoders(uint8_t mask) {
  for (uint8_t n = 0; n < EDGE_CHANNELS; ++n) {
    if ((mask & (1u << (FIRST_EDGE_CHANNEL + n))) != 0) {
      PIOD->PIO_IER = pins_of(n);
    } else {
      PIOD->PIO_IDR = pins_of(n);
    }
  }
}

void read_encoders(int32_t (&count)[CHANNELS], uint32_t (&missed)[CHANNELS]) {
  count[0] = static_cast<int32_t>(TC0->TC_CHANNEL[0].TC_CV);
  count[1] = static_cast<int32_t>(TC2->TC_CHANNEL[0].TC_CV);
  // Reading the register clears it: one error per tick at most.
  if ((TC0->TC_QISR & TC_QISR_QERR) != 0) missed[0] = missed[0] + 1;
  if ((TC2->TC_QISR & TC_QISR_QERR) != 0) missed[1] = missed[1] + 1;
  for (uint8_t n = 0; n < EDGE_CHANNELS; ++n) {
    count[FIRST_EDGE_CHANNEL + n] = decoder[n].count;
    missed[FIRST_EDGE_CHANNEL + n] = decoder[n].skipped;
  }
}

void read_edges(uint32_t (&a)[CHANNELS], uint32_t (&b)[CHANNELS]) {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    const bool hardware = i < FIRST_EDGE_CHANNEL;
    if (hardware) sampled[i].see(decoder_levels(i));
    const TrackEdges& tracks = hardware ? sampled[i] : decoder[i - FIRST_EDGE_CHANNEL].tracks;
    a[i] = tracks.a;
    b[i] = tracks.b;
  }
}

}  // namespace contid

#endif  // ARDUINO_ARCH_SAM
