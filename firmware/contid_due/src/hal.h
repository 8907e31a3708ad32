// Entry points of the hardware layer: setup and loop.
#ifndef CONTID_HAL_H
#define CONTID_HAL_H

void contid_setup();
void contid_loop();

#endif
