"""The sketch linked with the Teensy core, on an emulated Cortex-M7 with the registers that it uses."""
