// contid on an Arduino Due or a Teensy 4.1: geared motors with encoders, or pressure regulators. The portable core is
// in src/core, hardware layers and pin maps are in src/due and src/teensy41. Flash it unchanged; the role jumper
// selects pressure board or motor board.
#include "src/hal.h"

void setup() { contid_setup(); }

void loop() { contid_loop(); }
