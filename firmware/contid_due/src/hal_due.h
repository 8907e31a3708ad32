// The two entries of the sketch.
#ifndef CONTID_HAL_DUE_H
#define CONTID_HAL_DUE_H

void contid_setup();
void contid_loop();

#endif
