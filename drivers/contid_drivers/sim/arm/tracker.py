"""The tracker of a simulated tip: captures at its own rate, with noise, and reports after its latency."""

from __future__ import annotations

import random
from collections import deque

from contid.hal import TipMeasured
from contid.robot_file.cosserat import Cosserat
from contid.units import MM_PER_M
from contid_drivers.sim.arm.body import SimulatedBody


class TrackedArm:
    """One simulated arm and its tracker.

    Args:
        robot: its name.
        description: description with a ``sim``.

    Attributes:
        axes: names of its axes on the bus.
        body: follows their pressures, also between two captures: its hysteresis depends on all of them.
    """

    def __init__(self, robot: str, description: Cosserat) -> None:
        assert description.sim is not None
        self._robot = robot
        self._tracker = description.sim.tracker
        self._noise = random.Random(f"{self._tracker.seed}:{robot}")
        self._captures = 0
        self._underway: deque[TipMeasured] = deque()
        self.axes = [f"{robot}.{axis}" for axis in description.axis_names]
        self.body = SimulatedBody(description)

    def next_capture_s(self, opened_s: float) -> float:
        """When the tracker of a bus opened at ``opened_s`` captures next."""
        return opened_s + self._captures / self._tracker.rate_hz

    def capture(self, regulators_pa: list[float], now_s: float, t_s: float) -> None:
        """Measure the tip now, ``t_s`` after the bus was opened."""
        self._captures += 1
        self.body.follow(regulators_pa)
        if any(begin <= t_s < end for begin, end in self._tracker.hidden_s):
            return
        sigma = self._tracker.noise_mm / MM_PER_M
        x, y, z = (v + self._noise.gauss(0.0, sigma) for v in self.body.tip_in_world_m(t_s))
        self._underway.append(TipMeasured(self._robot, (x, y, z), now_s))

    def take_arrived(self, now_s: float) -> list[TipMeasured]:
        """Measurements whose latency is over."""
        out = []
        latency_s = self._tracker.latency_ms / 1e3
        while self._underway and self._underway[0].time_s + latency_s <= now_s:
            out.append(self._underway.popleft())
        return out
