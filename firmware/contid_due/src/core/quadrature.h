// Quadrature decoding of every edge (x4), run by an edge interrupt.
#ifndef CONTID_QUADRATURE_H
#define CONTID_QUADRATURE_H

#include <stdint.h>

namespace contid {

struct Quadrature {
  volatile int32_t count;
  volatile uint32_t skipped;  // both tracks changed at once: an edge was missed
  uint32_t levels;            // A in bit 1, B in bit 0

  void start(uint32_t now) {
    count = 0;
    skipped = 0;
    levels = now & 3u;
  }

  // Levels in Gray order 00 01 11 10 are positions 0 1 2 3; the step is the difference modulo 4.
  void edge(uint32_t now) {
    const uint32_t before = levels ^ (levels >> 1);
    const uint32_t after = now ^ (now >> 1);
    const uint32_t step = (after - before) & 3u;
    levels = now;
    if (step == 1u) {
      count = count + 1;
    } else if (step == 3u) {
      count = count - 1;
    } else if (step == 2u) {
      skipped = skipped + 1u;
    }
  }
};

}  // namespace contid

#endif
