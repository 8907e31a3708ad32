// The encoder inputs of a motor board.
#ifndef CONTID_HAL_ENCODERS_H
#define CONTID_HAL_ENCODERS_H

#include <stdint.h>

#include "../core/protocol.h"

namespace contid {

// Counts all channels from now on.
void start_encoders();

// Channels outside the mask interrupt no more: an open or noisy input takes no time from the tick.
void use_encoders(uint8_t mask);

// Counts, and edges missed since the start.
void read_encoders(int32_t (&count)[CHANNELS], uint32_t (&missed)[CHANNELS]);

// Level changes of the tracks since the start; call it once per tick.
void read_edges(uint32_t (&a)[CHANNELS], uint32_t (&b)[CHANNELS]);

}  // namespace contid

#endif
