"""Axes of the boards, and how long their bus is exchanged with."""

from __future__ import annotations

import time

from contid.hal import AxisOnBus
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions

MOTORS = [
    AxisOnBus(f"arm.l{i}", DueAxisOptions.model_validate({"channel": f"m{i}", "power_up_deg": 90.0}), None)
    for i in range(3)
]
PARKED = {"power_up_deg": 229.2, "homing": {"direction": -1, "at_deg": 199.2}}
AIR = {"calibration": [[0, 0], [100, 3]], "readback": [[600, 0], [3000, 3]], "ceiling_bar": 1.6}


def settle(bus: DueBus, seconds: float, commands=None):
    end = time.monotonic() + seconds
    while True:
        samples = bus.exchange(commands or {})
        if time.monotonic() > end:
            return samples
        time.sleep(0.005)
