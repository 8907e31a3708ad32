"""Simulated bodies, which extras offer, and the tracker that measures the tip of one.

The entry points of the group `contid.bodies` build a body from the description of a robot with `sim`: ``arm``
(a pneumatic arm at rest), ``finger`` (shafts with friction, on an object), ``rod`` (bodies in motion).
"""

from __future__ import annotations

import random
from collections import deque
from typing import Any, Protocol

from contid import entry_points
from contid.hal import TipMeasured
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.tendon.robot import TendonRobot
from contid.units import MM_PER_M
from contid_drivers.sim.bodies import BODIES, LoadedShafts


class SimulatedMotion(Protocol):
    """A body whose tip follows the actuators."""

    def follow(self, actuators: list[float], t_s: float) -> None:
        """The actuators reached values [Pa, or rad of a shaft] a time after the bus was opened."""

    def tip_in_world_m(self, t_s: float) -> tuple[float, float, float]:
        """Where the tip is."""


class TrackedBody:
    """One simulated body and its tracker.

    Args:
        robot: its name.
        description: description with a ``sim``.

    Attributes:
        axes: names of its axes on the bus.
        body: follows their values, also between two captures: hysteresis and motion depend on all of them.
    """

    def __init__(self, robot: str, description: Cosserat | TendonRobot) -> None:
        assert description.sim is not None
        self._robot = robot
        self._tracker = description.sim.tracker
        self._noise = random.Random(f"{self._tracker.seed}:{robot}")
        self._captures = 0
        self._underway: deque[TipMeasured] = deque()
        self.axes = [f"{robot}.{axis}" for axis in description.axis_names]
        self.body = _body(robot, description)

    def next_capture_s(self, opened_s: float) -> float:
        """When the tracker of a bus opened at ``opened_s`` captures next."""
        return opened_s + self._captures / self._tracker.rate_hz

    def capture(self, actuators: list[float], now_s: float, t_s: float) -> None:
        """Measure the tip now, ``t_s`` after the bus was opened."""
        self._captures += 1
        self.body.follow(actuators, t_s)
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


def loaded_shafts(robot: str, description: RackFinger) -> LoadedShafts:
    """The body of a simulated finger.

    Raises:
        ContidError: no installed package has one.
    """
    body: LoadedShafts = _load(robot, "finger")(robot, description)
    return body


def _body(robot: str, description: Cosserat | TendonRobot) -> SimulatedMotion:
    assert description.sim is not None
    is_at_rest = isinstance(description, Cosserat) and not description.sim.dynamics
    body: SimulatedMotion = _load(robot, "arm" if is_at_rest else "rod")(description)
    return body


def _load(robot: str, kind: str) -> Any:
    return entry_points.required(BODIES, kind, f"{robot}: its key `sim` (body {kind!r})", "dynamics")
