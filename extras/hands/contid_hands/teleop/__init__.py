"""Teleoperation: keys and input devices to set-points of a running daemon."""
