// Reads a converter of a load cell over two lines: HX711, HX717, ADS1232 and others of this kind.
//
// DOUT falls when a reading waits. 24 pulses of the clock shift it out, the highest bit first; the 25th chooses channel
// A with a gain of 128 for the next one, and DOUT goes high. A clock that stays high for 60 us switches the chip off:
// what interrupts a pulse is much shorter (HX711 data sheet, figure 2).
#ifndef CONTID_CONVERTER_H
#define CONTID_CONVERTER_H

#include <stdint.h>

namespace contid {

// `Lines` has data() and clock(bool), which last at least 0.2 us. True with a new reading.
template <class Lines> bool read_converter(const Lines& lines, int32_t& reading) {
  if (lines.data()) return false;
  uint32_t bits = 0;
  for (int32_t i = 0; i < 24; ++i) {
    lines.clock(true);
    bits = bits << 1 | (lines.data() ? 1u : 0u);
    lines.clock(false);
  }
  lines.clock(true);
  lines.clock(false);
  // 24 bit, two's complement.
  reading = static_cast<int32_t>(bits << 8) / 256;
  return true;
}

}  // namespace contid

#endif
