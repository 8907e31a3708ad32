"""The journal of a simulated bus: one JSON line per event with the state of every axis, written at once.

It shows what the devices did after the control process ended.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from contid.errors import DeviceError
from contid.hal import DeviceKind
from contid_drivers.sim.devices import SimDevice


def append_event(
    path: str, event: str, t_s: float, bus: str, devices: Mapping[str, SimDevice], subject: str
) -> None:
    """Append one event with the state of every axis.

    It takes one system call, so that a killed process leaves whole lines.

    Raises:
        DeviceError: the file cannot be written.
    """
    line = {
        "event": event,
        "t_s": t_s,
        "bus": bus,
        "subject": subject,
        "axes": {name: _state(device) for name, device in devices.items()},
    }
    try:
        with Path(path).open("ab", buffering=0) as file:
            file.write(json.dumps(line).encode() + b"\n")
    except OSError as error:
        raise DeviceError(bus, f"cannot write journal_file {path}: {error.strerror}") from error


def _state(device: SimDevice) -> dict[str, object]:
    unit = "pa" if device.kind is DeviceKind.REGULATOR else "rad"
    return {
        f"value_{unit}": device.motion.value,
        f"goal_{unit}": device.goal,
        "on": device.on,
        "rest": "" if device.on else device.rest.value,
        "fault": device.fault,
    }
