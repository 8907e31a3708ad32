// The pin map of both roles.
//
// Encoders of channels 0 and 1 are on the two hardware decoders whose pins the Due has (TC0: D2 and D13, TC2: D5
// and D4); those of channels 2 to 5 are decoded in pin interrupts and lie on neighbouring bits of port D.
// Bridges: what the two inputs and the PWM line mean is configuration (core/bridge.cpp). Fault outputs of bridges are
// open drains, low is a fault; unconnected is none. Analogue inputs take 0 to 3.3 V, not 5 V.
#ifndef CONTID_PINS_H
#define CONTID_PINS_H

#include <stdint.h>

namespace contid {

// To GND: a pressure board. Open: a motor board.
const uint8_t ROLE_JUMPER = 53;

struct ChannelPins {
  uint8_t pwm;          // pin of a PWM unit's low output
  uint8_t pwm_channel;  // of the SAM3X's PWM unit
  uint8_t in_a, in_b;   // direction of a motor; inlet and outlet of a pair of valves
  uint8_t fault;        // bridge fault, motor boards only
  uint8_t adc_channel;  // of the SAM3X's ADC: A0 is 7, A1 is 6, .. A5 is 2
};

const ChannelPins PINS[6] = {
    {9, 4, 38, 39, 22, 7},   // encoder D2, D13
    {8, 5, 40, 41, 23, 6},   // encoder D5, D4
    {7, 6, 42, 43, 24, 5},   // encoder D25, D26
    {6, 7, 44, 45, 31, 4},   // encoder D27, D28
    {34, 0, 46, 47, 33, 3},  // encoder D29, D11
    {36, 1, 48, 49, 35, 2},  // encoder D30, D32
};

// A load cell: an amplifier at A6 to A11, or a converter at two lines.
struct CellPins {
  uint8_t adc_channel;  // A6 is 1, A7 is 0, A8 is 10, .. A11 is 13
  uint8_t data, clock;
};

const CellPins CELL_PINS[6] = {{1, 50, 14}, {0, 51, 15}, {10, 52, 16}, {11, 10, 17}, {12, 12, 18}, {13, 37, 19}};

struct EdgePins {
  uint8_t a, b;
  uint8_t shift;  // bit of `a` in port D; `b` is the next
};

const uint8_t FIRST_EDGE_CHANNEL = 2;
const EdgePins EDGE_PINS[4] = {{25, 26, 0}, {27, 28, 2}, {29, 11, 6}, {30, 32, 9}};

const char MOTOR_PINS[] =
    "m0 pwm9 in38,39 enc2,13 flt22 A0; m1 pwm8 in40,41 enc5,4 flt23 A1; m2 pwm7 in42,43 enc25,26 flt24 A2; "
    "m3 pwm6 in44,45 enc27,28 flt31 A3; m4 pwm34 in46,47 enc29,11 flt33 A4; m5 pwm36 in48,49 enc30,32 flt35 A5; "
    "cells A6-A11 or data50,51,52,10,12,37 clock14-19";
const char PRESSURE_PINS[] =
    "p0 pwm9 v38,39 A0; p1 pwm8 v40,41 A1; p2 pwm7 v42,43 A2; p3 pwm6 v44,45 A3; p4 pwm34 v46,47 A4; "
    "p5 pwm36 v48,49 A5; jumper 53";

}  // namespace contid

#endif
