"""Calibration of tendon robots from recordings of pulls and tips."""
