"""The robot file of the laboratory on wires."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import yaml

from benchmarks.lab import MEMBERS, lab_text

RATE_HZ: Final = 100.0
#: The emulators share two cores with everything else: long timeouts, so that only injected faults occur.
TOLERANCE_TICKS: Final = 20
LONG_TIMEOUTS: Final = {
    "dynamixel": {"usb_latency_ms": 15, "watchdog_ms": 400},
    "due": {"latency_ms": 15, "watchdog_ms": 400},
}


def robot_file(
    folder: Path,
    on_interrupt: Mapping[str, str] | None = None,
    driver: str = "",
    members: Sequence[str] = MEMBERS,
) -> Path:
    """The laboratory's file, its ports in a folder; with a ``driver`` only its buses and their robots."""
    raw = yaml.safe_load(lab_text(RATE_HZ, ".emulated", members))
    raw["buses"] = {name: bus for name, bus in raw["buses"].items() if driver in ("", bus["driver"])}
    raw["robots"] = {
        name: robot
        for name, robot in raw["robots"].items()
        if all(axis["bus"] in raw["buses"] for axis in robot["axes"].values())
    }
    for name, bus in raw["buses"].items():
        bus |= {"port": f"{folder}/{name}.tty", "tolerance_ticks": TOLERANCE_TICKS} | LONG_TIMEOUTS[
            bus["driver"]
        ]
    for name, robot in raw["robots"].items():
        robot.pop("placeholder", None)
        robot["stop"]["on_interrupt"] = (on_interrupt or {}).get(name, robot["stop"]["on_interrupt"])
    path = folder / "lab.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False, default_flow_style=None))
    return path
