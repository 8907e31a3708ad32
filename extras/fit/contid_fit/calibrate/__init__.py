"""Fits from measurements, written back into the robot file."""
