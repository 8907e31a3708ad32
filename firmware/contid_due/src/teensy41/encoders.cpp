// Encoders of a Teensy 4.1: four hardware decoders (ENC1 to ENC4), which the crossbar connects to pins.
//
// Every input is filtered: a level must stay for 6 samples, 20 clocks of 150 MHz apart (0.8 us).
#ifdef ARDUINO_TEENSY41

#include "encoders.h"

#include <Arduino.h>

#include "../core/quadrature.h"
#include "pins.h"

namespace contid {

namespace {

// Filtered levels of the tracks in the input monitor register, IMR.
const uint16_t LEVEL_A = 0x0080, LEVEL_B = 0x0040;
TrackEdges sampled[MOTORS];

// The first of the five crossbar outputs of each decoder: track A, then track B.
const uint8_t TRACK_A[MOTORS] = {66, 71, 76, 81};
const uint16_t FILTER = 3u << 8 | 20u;            // 3 + 3 samples, 20 clocks
const uint16_t LOAD_POSITION = 0x0800;            // CTRL.SWIP: the counter takes UINIT, LINIT
const uint16_t BOTH_CHANGED = 0x0800;             // CTRL2.SABIRQ; writing it clears it
const uint16_t FLAGS = 0x0800 | 0x0080 | 0x0020;  // of CTRL2; cleared by writing ones

IMXRT_ENC_t& decoder(uint8_t channel) {
  static IMXRT_ENC_t* const decoders[MOTORS] = {&IMXRT_ENC1, &IMXRT_ENC2, &IMXRT_ENC3, &IMXRT_ENC4};
  return *decoders[channel];
}

uint32_t levels(uint8_t channel) {
  const uint16_t monitor = decoder(channel).IMR;
  return ((monitor & LEVEL_A) != 0 ? 2u : 0u) | ((monitor & LEVEL_B) != 0 ? 1u : 0u);
}

// Which of its pins an input of the crossbar listens to.
void select_pin(uint8_t crossbar) {
  switch (crossbar) {
    case 6:
      IOMUXC_XBAR1_IN06_SELECT_INPUT = 0;
      break;
    case 7:
      IOMUXC_XBAR1_IN07_SELECT_INPUT = 0;
      break;
    case 8:
      IOMUXC_XBAR1_IN08_SELECT_INPUT = 0;
      break;
    case 9:
      IOMUXC_XBAR1_IN09_SELECT_INPUT = 0;
      break;
    case 16:
      IOMUXC_XBAR1_IN16_SELECT_INPUT = 0;
      break;
    case 17:
      IOMUXC_XBAR1_IN17_SELECT_INPUT = 1;
      break;
    case 22:
      IOMUXC_XBAR1_IN22_SELECT_INPUT = 0;
      break;
    default:
      IOMUXC_XBAR1_IN23_SELECT_INPUT = 0;
      break;
  }
}

void connect(uint8_t input, uint8_t output) {
  volatile uint16_t* const select = &XBARA1_SEL0 + output / 2;
  const uint16_t other = output % 2 == 0 ? *select & 0xFF00u : *select & 0x00FFu;
  *select = static_cast<uint16_t>(other | (output % 2 == 0 ? input : input << 8));
}

void start_track(const TrackPin& track, uint8_t output) {
  *portControlRegister(track.pin) =
      IOMUXC_PAD_HYS | IOMUXC_PAD_PUS(3) | IOMUXC_PAD_PUE | IOMUXC_PAD_PKE;  // 22 kOhm to 3.3 V
  select_pin(track.crossbar);
  connect(track.crossbar, output);
  *portConfigRegister(track.pin) = track.alternate;
}

}  // namespace

void start_encoders() {
  CCM_CCGR2 |= CCM_CCGR2_XBAR1(CCM_CCGR_ON);
  CCM_CCGR4 |= CCM_CCGR4_ENC1(CCM_CCGR_ON) | CCM_CCGR4_ENC2(CCM_CCGR_ON) | CCM_CCGR4_ENC3(CCM_CCGR_ON) |
               CCM_CCGR4_ENC4(CCM_CCGR_ON);
  for (uint8_t i = 0; i < MOTORS; ++i) {
    start_track(TRACK_PINS[i][0], TRACK_A[i]);
    start_track(TRACK_PINS[i][1], static_cast<uint8_t>(TRACK_A[i] + 1));
    IMXRT_ENC_t& unit = decoder(i);
    unit.CTRL = 0;  // counts every edge of both tracks
    unit.FILT = FILTER;
    unit.CTRL2 = FLAGS;
    unit.UINIT = 0;
    unit.LINIT = 0;
    unit.CTRL = LOAD_POSITION;
    sampled[i].start(levels(i));
  }
}

void read_encoders(int32_t (&count)[CHANNELS], uint32_t (&missed)[CHANNELS]) {
  for (uint8_t i = 0; i < MOTORS; ++i) {
    IMXRT_ENC_t& unit = decoder(i);
    const uint32_t upper = unit.UPOS;  // reading it holds the lower half
    count[i] = static_cast<int32_t>(upper << 16 | unit.LPOSH);
    if ((unit.CTRL2 & BOTH_CHANGED) == 0) continue;
    unit.CTRL2 = BOTH_CHANGED;
    ++missed[i];
  }
}

void read_edges(uint32_t (&a)[CHANNELS], uint32_t (&b)[CHANNELS]) {
  for (uint8_t i = 0; i < MOTORS; ++i) {
    sampled[i].see(levels(i));
    a[i] = sampled[i].a;
    b[i] = sampled[i].b;
  }
}

}  // namespace contid

#endif  // ARDUINO_TEENSY41
