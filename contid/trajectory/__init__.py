"""Targets over time: files and streams, interpolation, jerk-limited approach and stop."""
