"""Checks of the servos of a bus before they may move."""
