// Identity of the board, and of its present start.
#ifndef CONTID_TEENSY41_IDENTITY_H
#define CONTID_TEENSY41_IDENTITY_H

#include "../core/board.h"

namespace contid {

// Counts the start, draws its random number, and reads the chip's id and the cause of the reset. Once per start.
void read_identity(Identity& identity);

}  // namespace contid

#endif
