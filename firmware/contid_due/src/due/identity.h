// Identity of the board, and of its present start.
#ifndef CONTID_HAL_IDENTITY_H
#define CONTID_HAL_IDENTITY_H

#include "../core/board.h"

namespace contid {

// Counts the start, draws its random number, and reads the chip's id and the cause of the reset. Once per start,
// before any interrupt is enabled.
void read_identity(Identity& identity);

// Gives the board a serial number on USB, from its chip id: computers name the port by it.
void number_usb(const Identity& identity);

}  // namespace contid

#endif
