// An emulated Due: the sketch's core, its plant, its resets, and a journal of events.
#ifndef CONTID_MACHINE_H
#define CONTID_MACHINE_H

#include <cstdio>
#include <string>
#include <vector>

#include "../contid_due/src/core/link.h"
#include "identity.h"
#include "plant.h"

namespace contid {

// What an emulated board has instead of a Due's parts.
struct Parts {
  uint16_t adc_steps = 4095, adc_mv = 3300;
  int bridges = -1, capabilities = -1;  // as in hello; -1: as the emulator has them
};

class Machine {
 public:
  // `boot_id` is that of the first start; every further one gets the next.
  // `since_tick_us` is null in lockstep, where no time passes between ticks.
  Machine(Role role, FILE* journal, const Parts& parts = Parts(), uint32_t boot_id = FIRST_BOOT_ID,
          uint32_t (*since_tick_us)() = nullptr)
      : role_(role), journal_(journal), parts_(parts), since_tick_us_(since_tick_us), boot_id_(boot_id) {
    plant.adc_steps = parts.adc_steps;
    boot(ResetCause::POWER_UP, 0);
  }

  // The timer interrupt and one millisecond of the world.
  void tick();
  // A byte for the sketch; answers are appended to `reply`. A board that starts (until its first tick) or whose
  // loop() is frozen receives nothing: the caller keeps the byte.
  void take(uint8_t byte, std::vector<uint8_t>& reply, PortId port = PortId::NATIVE);
  bool receives() const { return starting_ms_ == 0 && frozen_ms_ == 0 && ticked_; }

  void reset(ResetCause cause, uint32_t uptime_ms = 0);
  // loop() stands still: after the watchdog's 32 ms the board resets, as the hardware would.
  void freeze(uint32_t ms) { frozen_ms_ = ms; }
  void count_dropped() { board_.count_dropped_answer(); }

  // One command line (see firmware/host/README.md); answers are written to `out`. False: not understood.
  bool command(const std::string& line, std::string& out);

  Plant plant;

 private:
  void boot(ResetCause cause, uint32_t uptime_ms);
  void note();
  Role role_;
  FILE* journal_;
  Parts parts_;
  Board board_;
  Link link_, other_port_;
  uint32_t (*since_tick_us_)();
  Outputs outputs_ = Outputs();
  uint32_t boot_id_;
  uint16_t boots_ = 0;
  uint64_t world_ms_ = 0;
  uint32_t starting_ms_ = 0, frozen_ms_ = 0, unfed_ms_ = 0;
  bool watchdog_fires_ = true, ticked_ = false;
  State state_[CHANNELS] = {};
  Reason reason_[CHANNELS] = {};
  bool resting_[CHANNELS] = {};
};

}  // namespace contid

#endif
