"""Drivers: one folder per kind of hardware, and the simulated devices; what they share is `contid.kit`."""
