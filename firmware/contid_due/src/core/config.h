// The configuration of a board.
#ifndef CONTID_CONFIG_H
#define CONTID_CONFIG_H

#include "bytes.h"
#include "protocol.h"

namespace contid {

// A load cell in the tendon that a motor pulls.
struct TensionConfig {
  bool fitted;
  bool converter;                        // else an amplifier at an analogue pin
  int32_t pull;                          // 1: counting up tightens; -1
  int32_t raw_low, low, raw_high, high;  // two points, steps and mN; the second reads more
  int32_t valid_low, valid_high;         // outside no reading is a tension
  int32_t silent_ms;                     // longest time between two readings of a converter
  int32_t floor, ceiling;                // [mN]
  int32_t give;                          // counts per N of the stiffest tendon, times 256
  int32_t take_up;                       // way that the floor may take from a demand [counts]
  int32_t slack_ms;
};

struct MotorConfig {
  Safe safe, start;
  Bridge bridge;
  bool encoder_reversed, motor_reversed, homing, home_up;
  int32_t low, high;               // travel [counts]
  int32_t velocity, acceleration;  // [counts/s], [counts/s2]
  int32_t kp;                      // speed per position error [1/s] times 256
  int32_t ks, ki, kv;              // duty (full = 32767) times 256 per count/s of error, per count of it, per count/s
  int32_t ka;                      // duty times 65536 per count/s2
  int32_t friction;                // duty
  int32_t deadband;                // [counts]
  int32_t stall_duty, stall_ms;
  int32_t stall_current_ma;  // 0: no sensor
  int32_t full_scale_ma;     // current at the top of the analogue input
  int32_t adc_steps;         // the top of the analogue input
  int32_t follow;            // greatest following error [counts]
  int32_t power_up;          // position of the parked shaft [counts]
  int32_t home_velocity, home_duty, home_at, home_backoff, home_timeout_ms, home_repeat;
  TensionConfig tension;
};

struct RegulatorConfig {
  Safe safe;
  int32_t ceiling, slew, vent;           // [Pa], [Pa/s], [Pa/s]
  int32_t raw_low, low, raw_high, high;  // read-back: two points, ADC steps and Pa
  int32_t wire_raw;                      // below: broken wire; 0: not monitored
  int32_t adc_steps;                     // the top of the analogue input
  int32_t leak, leak_ms;                 // [Pa]
  int32_t over, over_ms;                 // [Pa]
  int32_t lag_ms;                        // with which the reading follows a step, longest
  int32_t trim, trim_rate;               // outer loop: limit of its correction [Pa]; 1/s times 256
  int32_t points;                        // calibration: duty at pressure; 0: a pair of valves
  int32_t duty[TABLE_POINTS], pressure[TABLE_POINTS];
  bool outlet_open;            // without power
  int32_t valve_ms, least_ms;  // longest time of a valve to open or to shut; shortest pulse
  int32_t band;                // error without a pulse [Pa]
  bool valves() const { return points == 0; }
  // Whether a reset shuts the chamber.
  bool keeps() const { return valves() && !outlet_open; }
};

struct BoardConfig {
  uint8_t mask;
  int32_t watchdog_ms;
  MotorConfig motor[CHANNELS];
  RegulatorConfig regulator[CHANNELS];
};

struct Verdict {
  Refusal refusal;
  uint16_t detail;
};

inline Verdict accepted() { return Verdict{Refusal::NONE, 0}; }

// Reads and checks a configuration for a board of this role, whose analogue inputs have this many steps.
Verdict read_config(Reader& in, Role role, int32_t adc_steps, BoardConfig& out);

}  // namespace contid

#endif
