// Quadrature decoding of every edge (x4), run by an edge interrupt.
#ifndef CONTID_QUADRATURE_H
#define CONTID_QUADRATURE_H

#include <stdint.h>

namespace contid {

// Level changes of the two tracks of one encoder, A in bit 1 and B in bit 0.
struct TrackEdges {
  volatile uint32_t a, b;
  uint32_t levels;

  void start(uint32_t now) {
    a = 0;
    b = 0;
    levels = now & 3u;
  }

  void see(uint32_t now) {
    const uint32_t changed = now ^ levels;
    levels = now;
    a = a + (changed >> 1);
    b = b + (changed & 1u);
  }
};

struct Quadrature {
  volatile int32_t count;
  volatile uint32_t skipped;  // both tracks changed at once: an edge was missed
  TrackEdges tracks;

  void start(uint32_t now) {
    count = 0;
    skipped = 0;
    tracks.start(now);
  }

  // Levels in Gray order 00 01 11 10 are positions 0 1 2 3; the step is the difference modulo 4.
  void edge(uint32_t now) {
    const uint32_t before = tracks.levels ^ (tracks.levels >> 1);
    const uint32_t after = now ^ (now >> 1);
    const uint32_t step = (after - before) & 3u;
    tracks.see(now);
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
