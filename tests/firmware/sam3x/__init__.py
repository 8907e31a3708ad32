"""An emulated SAM3X8E, to the registers: runs the sketch's machine code as it is flashed."""
