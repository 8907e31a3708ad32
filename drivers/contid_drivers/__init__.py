"""Drivers: one folder per kind of hardware, and the simulated devices."""
