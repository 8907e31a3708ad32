"""Gamepads and 3D mice: events of the Linux kernel to shares of the speed, under a dead-man button."""
