"""Devices before a run: found, numbered, flashed, diagnosed, homed, and put into a robot file."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "new": ("contid_devices.new", "a robot file of your own, copied from a shipped one"),
    "scan": ("contid_devices.scan", "find devices on serial ports"),
    "home": ("contid_devices.homing.command", "find the zero of axes and write it into the robot file"),
    "servo": ("contid_devices.servo", "set the id or baud rate of a servo, or restart it"),
    "doctor": ("contid_devices.doctor", "problems of buses and host, with remedies"),
    "firmware": ("contid_devices.firmware", "build, flash and inspect the sketch of the Due boards"),
}
