"""Targets over time: files and streams, shapes, sampling, jerk-limited approach and stop."""
