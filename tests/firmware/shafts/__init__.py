"""Shafts with broken and with whole encoders on the core of the boards; the plant is not the emulator's."""
