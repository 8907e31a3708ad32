// Numbers of the protocol: the reference for PROTOCOL.md and drivers/contid_drivers/due/codes.py, which a test
// compares.
#ifndef CONTID_PROTOCOL_H
#define CONTID_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

namespace contid {

const uint8_t PROTOCOL_VERSION = 6;
const uint8_t FIRMWARE_MAJOR = 1;
const uint8_t FIRMWARE_MINOR = 7;
const uint8_t FIRMWARE_PATCH = 2;

const uint8_t CHANNELS = 6;
const uint8_t TABLE_POINTS = 8;

// Header (version, type, sequence number) and CRC around a body.
const size_t HEADER_SIZE = 3;
const size_t CRC_SIZE = 2;
const size_t MAX_PAYLOAD = 896;
const size_t MAX_ANSWER = 400;

enum Message : uint8_t {
  HELLO = 0x01,
  CONFIGURE = 0x02,
  ARM = 0x03,
  DEMAND = 0x04,
  CLEAR = 0x05,
  STOP = 0x06,
  HOME = 0x07,
  PARK = 0x08,
  PULSE = 0x09,
  TRACE = 0x0A,
  HELLO_ANSWER = 0x81,
  CONFIGURED = 0x82,
  TELEMETRY = 0x84,
  PULSED = 0x8A,
  REFUSED = 0xFF,
};

enum class Role : uint8_t { MOTOR = 0, PRESSURE = 1 };

enum class Rest : uint8_t { HOLD = 0, RELAX = 1, VENT = 2 };

enum class Safe : uint8_t { BRAKE = 0, COAST = 1, HOLD = 2, VENT = 3, CLOSE = 4 };

// Kind of H-bridge, by its lines (bridge.cpp).
enum class Bridge : uint8_t { PWM_IN_IN = 0, TB6612 = 1, IN_IN = 2, DIR_PWM = 3 };

const uint8_t ALL_BRIDGES = 0x0F;

enum class State : uint8_t {
  OFF = 0,      // not configured; the pins of a motor are not driven
  READY = 1,    // configured, never armed: the start state
  ARMED = 2,    // follows demands, under the watchdog
  HOMING = 3,   // searches its end stop, under the watchdog
  STOPPED = 4,  // rests as the host requested
  SAFE = 5,     // safe state, latched with its reason
  PULSING = 6,  // an open-loop pulse, or its trace, is under way
};

enum class Reason : uint8_t {
  NONE = 0,
  WATCHDOG = 1,
  STALLED = 2,
  ENCODER_SILENT = 3,
  ENCODER_REVERSED = 4,
  FOLLOWING = 5,
  HOME_FAILED = 6,
  SENSOR_WIRE = 7,
  LEAK = 8,
  OVER_PRESSURE = 9,
  BRIDGE = 10,  // the H-bridge reports a fault of its own
  ABOVE_SET_POINT = 11,
  NOT_VENTING = 12,
  ENCODER_EDGES = 13,  // edges of the encoder were missed
  HOME_TWICE = 14,     // the shaft stood still at two places
  HOME_MOVED = 15,     // the end stop is elsewhere than when the motor was homed before
  ENCODER_TRACK = 16,  // the count goes to and fro under drive: one open track
  READ_BACK = 17,      // the reading stands still while the set-point moves
  CELL = 18,           // a load cell without a reading, or out of its range
  CELL_FROZEN = 19,    // its readings are alike to the last bit while the shaft moves
  CELL_OTHER = 20,     // it answers another tendon
  SLACK = 21,          // the tension stays below half its floor
  SNAP = 22,           // the tension fell to nothing within milliseconds
  OVER_TENSION = 23,
};

enum class Refusal : uint8_t {
  NONE = 0,
  UNKNOWN_MESSAGE = 1,
  WRONG_VERSION = 2,  // detail: the board's version
  WRONG_LENGTH = 3,   // detail: bytes of body received
  WRONG_CRC = 4,      // detail: the board's configuration CRC
  NOT_CONFIGURED = 5,
  BAD_CHANNEL = 6,        // detail: the channel or mask
  BAD_VALUE = 7,          // detail: offset of the byte behind it in the payload; the value of a stop or park
  SAFE_IS_NOT_START = 8,  // detail: the channel
  WRONG_ROLE = 9,         // detail: the board's role
  ARMED_NOW = 10,
  LATCHED = 11,        // detail: the channel; clear first
  NOT_HOMED = 12,      // detail: the channel
  NO_SENSOR = 13,      // detail: the channel
  NO_HOMING = 14,      // detail: the channel
  PERSISTS = 15,       // detail: the channel
  POSITION_LOST = 16,  // detail: the channel; home it, or park it
  OTHER_PORT = 17,     // detail: the port that commands the board
  STALE = 18,          // the order of a pulse waited somewhere, or came twice
};

// Ports of a board. While a channel is armed or homing, only the port that commands it may command.
enum class PortId : uint8_t { NATIVE = 0, PROGRAMMING = 1 };

enum class ResetCause : uint8_t { POWER_UP = 0, BACKUP = 1, WATCHDOG = 2, SOFTWARE = 3, PIN = 4, BROWN_OUT = 5 };

// Capabilities of a channel in hello; 0: not fitted.
const uint8_t HARDWARE_DECODER = 1;
const uint8_t EDGE_DECODER = 2;
const uint8_t CURRENT_SENSE = 4;
const uint8_t BRIDGE_FAULT = 8;
const uint8_t READ_BACK = 16;
const uint8_t VALVE_PAIR = 32;
const uint8_t CELL_ANALOG = 64;      // an amplifier of a load cell at an analogue pin
const uint8_t CELL_CONVERTER = 128;  // a converter of the kind of the HX711

// Bits beside the state in telemetry.
const uint8_t CHANNEL_HOMED = 0x10;
const uint8_t CHANNEL_LIMITED = 0x20;
const uint8_t CHANNEL_SENSOR_OK = 0x40;
const uint8_t CHANNEL_POSITION_LOST = 0x80;

// Flags of the board, in hello and telemetry.
const uint8_t BOARD_CONFIGURED = 0x01;
const uint8_t BOARD_DEMAND_STALE = 0x02;
const uint8_t BOARD_POSITION_LOST = 0x04;
const uint8_t BOARD_SUPPLY_LOW = 0x08;  // the 3.3 V were too low since the last telemetry

const size_t UNIQUE_ID_SIZE = 16;

// Velocity of a demand whose host does not know it.
const int32_t NO_VELOCITY = -2147483647 - 1;

// Tension of a cell that shows none, and bound of the others [mN].
const int32_t NO_TENSION = -2147483647 - 1;
const int32_t TENSION_MOST = 10000000;

// Duty at full scale, either direction; the hardware layer scales it to its PWM period.
const int32_t DUTY_FULL = 32767;

const uint32_t TICK_HZ = 1000;

// Bounds of an open-loop pulse, and the length of its trace.
const int32_t PULSE_DUTY = DUTY_FULL / 5;
const uint8_t PULSE_MS = 30;
const uint8_t TRACE_MS = 96;
const uint8_t CURRENT_EVERY_MS = 2;
const uint8_t NO_CHANNEL = 0xFF;

}  // namespace contid

#endif
