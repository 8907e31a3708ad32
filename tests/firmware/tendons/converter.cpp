// A converter by its data sheet: DOUT is low when a reading waits, the rising clock shifts a bit out, the 25th pulse
// ends it. For each reading of stdin prints `PULSES_BEFORE,PULSES,CLOCK,DOUT,READING`.
#include "contid_due/src/converter.h"

#include <cstdio>
#include <iostream>

namespace {

struct Chip {
  uint32_t bits = 0;
  int pulses = 0;
  bool ready = false, high = false;

  bool dout() const { return !ready || (pulses > 0 && (pulses > 24 || (bits >> (24 - pulses) & 1u) != 0)); }
  void clock(bool level) {
    if (level && !high) ++pulses;
    high = level;
  }
};

struct Lines {
  Chip* chip;
  bool data() const { return chip->dout(); }
  void clock(bool level) const { chip->clock(level); }
};

}  // namespace

int main() {
  int32_t given;
  while (std::cin >> given) {
    Chip chip;
    chip.bits = static_cast<uint32_t>(given) & 0xFFFFFFu;
    int32_t reading = 0;
    const Lines lines = {&chip};
    const bool early = contid::read_converter(lines, reading);
    const int before = chip.pulses + (early ? 100 : 0);
    chip.ready = true;
    if (!contid::read_converter(lines, reading)) return 1;
    std::printf("%d,%d,%d,%d,%d\n", before, chip.pulses, chip.high ? 1 : 0, chip.dout() ? 1 : 0, reading);
  }
  return 0;
}
