// contid on an Arduino Due: geared motors with encoders, or pressure regulators. What it does is in src/core,
// how the Due does it in src/hal_due.cpp, which pin is what in src/pins.h. Flash it unchanged; the jumper in
// pins.h tells a pressure board from a motor board.
#include "src/hal_due.h"

void setup() { contid_setup(); }

void loop() { contid_loop(); }
