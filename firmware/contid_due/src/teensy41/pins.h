// The pin map of both roles on a Teensy 4.1, by its schematic and the processor's multiplexer.
//
// Encoders are on the four hardware decoders, which the crossbar connects to the pins below: four motors, or six
// regulators, four of which may be pairs of valves (v inlet,outlet). What the two inputs and the PWM line of a bridge
// mean is configuration (core/bridge.cpp). Fault outputs of bridges are open drains, low is a fault; unconnected is
// none. No pin takes more than 3.3 V.
#ifndef CONTID_TEENSY41_PINS_H
#define CONTID_TEENSY41_PINS_H

#include <stdint.h>

namespace contid {

const uint8_t MOTORS = 4;

// To GND: a pressure board. Open: a motor board.
const uint8_t ROLE_JUMPER = 41;

struct PwmPin {
  uint8_t pin;
  uint8_t unit;       // FlexPWM 2 or 3
  uint8_t submodule;  // of the unit; A and B of one have their own duty
  bool b;             // output B, else A
  uint8_t alternate;  // of the pin's multiplexer
};

const PwmPin PWM_PINS[6] = {{6, 2, 2, false, 2}, {9, 2, 2, true, 2},   {29, 3, 1, false, 1},
                            {28, 3, 1, true, 1}, {36, 2, 3, false, 6}, {37, 2, 3, true, 6}};

// Analogue pins A0 to A5, and their channels of ADC1.
const uint8_t ANALOG_PINS[6] = {14, 15, 16, 17, 18, 19};
const uint8_t ADC_CHANNELS[6] = {7, 8, 12, 11, 6, 5};

// Load cells of the motors: an amplifier at A6 to A9, and after the six above the channels of ADC1; or a converter
// whose data line is the same pin.
const uint8_t CELL_PINS[4] = {20, 21, 22, 23};
const uint8_t CELL_ADC_CHANNELS[4] = {15, 0, 13, 14};
const uint8_t CELL_CLOCKS[4] = {36, 37, 38, 39};

struct BridgePins {
  uint8_t in_a, in_b, fault;
};

const BridgePins BRIDGE_PINS[MOTORS] = {{10, 11, 5}, {12, 24, 7}, {25, 32, 8}, {34, 35, 26}};

// A track of an encoder: alternate 1 or 3 of the multiplexer puts the pin on an input of the crossbar.
struct TrackPin {
  uint8_t pin, alternate, crossbar;
};

const TrackPin TRACK_PINS[MOTORS][2] = {
    {{0, 1, 17}, {1, 1, 16}}, {{2, 3, 6}, {3, 3, 7}}, {{4, 3, 8}, {33, 3, 9}}, {{30, 1, 23}, {31, 1, 22}}};

const char MOTOR_PINS[] =
    "m0 pwm6 in10,11 enc0,1 flt5 A0; m1 pwm9 in12,24 enc2,3 flt7 A1; m2 pwm29 in25,32 enc4,33 flt8 A2; "
    "m3 pwm28 in34,35 enc30,31 flt26 A3; cells A6-A9 or data20-23 clock36-39";
const char PRESSURE_PINS[] =
    "p0 pwm6 v10,11 A0; p1 pwm9 v12,24 A1; p2 pwm29 v25,32 A2; p3 pwm28 v34,35 A3; p4 pwm36 A4; p5 pwm37 A5; jumper 41";

}  // namespace contid

#endif
