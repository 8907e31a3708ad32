// contid on an Arduino Due: geared motors with encoders, or pressure regulators. The portable core is in src/core,
// the hardware layer in src/hal_due.cpp, the pin map in src/pins.h. Flash it unchanged; the jumper in pins.h
// selects the role, pressure board or motor board.
#include "src/hal_due.h"

void setup() { contid_setup(); }

void loop() { contid_loop(); }
