"""Checks of a trajectory before any motion: its rows, the curve between them, distances of the bodies."""
