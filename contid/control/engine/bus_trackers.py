"""Trackers that are buses, such as that of a simulated arm: their tips as the messages of any tracker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from contid.control.engine.messages import Measured
from contid.hal import Bus, MeasuresTips


class BusTrackers:
    """The buses of a run that measure tips; a replay has their messages in the recording instead."""

    def __init__(self, buses: Iterable[Bus]) -> None:
        self._buses = [bus for bus in buses if isinstance(bus, MeasuresTips)]

    def arrived(self, deadline_s: float) -> Iterator[Measured]:
        """What arrived since the last call; ages are those at the deadline of a tick."""
        for bus in self._buses:
            for tip in bus.measured_tips():
                yield Measured(tip.robot, tip.tip_in_world_m, age_s=max(0.0, deadline_s - tip.time_s))
