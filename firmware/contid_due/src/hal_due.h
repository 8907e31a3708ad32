// Entry points of the sketch: setup and loop.
#ifndef CONTID_HAL_DUE_H
#define CONTID_HAL_DUE_H

void contid_setup();
void contid_loop();

#endif
