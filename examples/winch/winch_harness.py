"""The winch driver under contid's contract: the emulated box on this machine's own network, in real time.

From a checkout of contid: ``python -m pytest tests/contract -k winch``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from contid.hal import AxisOnBus, DeviceKind, Rest
from contid_driverkit import MonotonicClock
from contid_driverkit.contract import Facts, RealTimeRig
from contid_winch import AxisOptions, BusOptions
from contid_winch.bus import WinchBus
from contid_winch.emulator import Box, Drum

STEP = math.tau / 3200
DRUMS = {"left.a": 1, "left.b": 4, "right.a": 5}


class WinchRig(RealTimeRig):
    """A `contid_driverkit.contract.BusUnderTest` of one emulated box."""

    def __init__(self, box: Box) -> None:
        self.facts = Facts(
            kind=DeviceKind.MOTOR,
            still=STEP,
            reading=2 * STEP,
            near=0.5,
            far=50.0,
            settle_s=0.15,
            watchdog_s=0.15,
            vent_s=0.0,
            on_watchdog=Rest.RELAX,
        )
        self.box = box
        host, port = box.address
        options = BusOptions(address=f"{host}:{port}", watchdog_ms=150, reply_ms=60.0)
        axes = [AxisOnBus(axis, AxisOptions(drum=drum)) for axis, drum in DRUMS.items()]
        self.bus = WinchBus("box", options, axes, MonotonicClock())

    def value(self, axis: str) -> float:
        with self._drum(axis) as drum:
            return drum.position * STEP

    def powered(self, axis: str) -> bool:
        with self._drum(axis) as drum:
            return drum.state in ("on", "held")

    def silence(self, axis: str, silent: bool) -> None:
        with self._drum(axis) as drum:
            drum.silent = silent

    def unplug(self) -> None:
        self.box.unplug()

    def plug(self) -> None:
        self.box.plug()

    def break_device(self, axis: str) -> None:
        with self._drum(axis) as drum:
            drum.rest("jammed")
            drum.cause = "jammed"

    def repair_device(self, axis: str) -> None:
        with self._drum(axis) as drum:
            drum.cause = ""

    @contextmanager
    def _drum(self, axis: str) -> Iterator[Drum]:
        with self.box.locked_drums() as drums:
            yield drums[DRUMS[axis]]


@contextmanager
def winch() -> Iterator[WinchRig]:
    with Box(("127.0.0.1", 0), list(DRUMS.values())) as box:
        rig = WinchRig(box)
        yield rig
        rig.bus.close()
