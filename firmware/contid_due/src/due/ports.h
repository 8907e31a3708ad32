// The two ports of the board.
#ifndef CONTID_HAL_PORTS_H
#define CONTID_HAL_PORTS_H

#include "../core/link.h"

namespace contid {

void start_ports();

// Moves bytes between the ports and the board. Never waits.
void serve_ports(Board& board);

}  // namespace contid

#endif
