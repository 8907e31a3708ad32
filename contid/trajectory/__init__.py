"""Targets over time: files and streams, shapes, interpolation, jerk-limited approach and stop."""
