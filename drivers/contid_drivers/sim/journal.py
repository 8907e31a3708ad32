"""The journal of a simulated bus: one JSON line per event with the state of every axis, written at once.

It shows what the devices did after the control process ended.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping

from contid.errors import DeviceError
from contid.hal import DeviceKind
from contid_drivers.sim.devices import SimDevice


class Journal:
    """Appends to a file with one system call per line, so that a killed process leaves whole lines."""

    def __init__(self, path: str | None) -> None:
        self._path = path

    def write(
        self, event: str, t_s: float, bus: str, devices: Mapping[str, SimDevice], subject: str = ""
    ) -> None:
        """Append one event with the state of every axis."""
        if self._path is None:
            return
        line = {
            "event": event,
            "t_s": t_s,
            "bus": bus,
            "subject": subject,
            "axes": {name: _state(device) for name, device in devices.items()},
        }
        try:
            fd = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            try:
                os.write(fd, json.dumps(line).encode() + b"\n")
            finally:
                os.close(fd)
        except OSError as error:
            raise DeviceError(bus, f"cannot write journal_file {self._path}: {error.strerror}") from error


def _state(device: SimDevice) -> dict[str, object]:
    unit = "pa" if device.kind is DeviceKind.REGULATOR else "rad"
    return {
        f"value_{unit}": device.motion.value,
        f"goal_{unit}": device.goal,
        "on": device.on,
        "rest": "" if device.on else device.rest.value,
        "fault": device.fault,
    }
