// The encoder inputs of a motor board.
#ifndef CONTID_TEENSY41_ENCODERS_H
#define CONTID_TEENSY41_ENCODERS_H

#include "../core/protocol.h"

namespace contid {

// Counts all channels from now on.
void start_encoders();

// Counts, and times that both tracks changed at once, since the start.
void read_encoders(int32_t (&count)[CHANNELS], uint32_t (&missed)[CHANNELS]);

// Level changes of the tracks that samples of 1 ms show, since the start; call it once per tick.
void read_edges(uint32_t (&a)[CHANNELS], uint32_t (&b)[CHANNELS]);

}  // namespace contid

#endif
