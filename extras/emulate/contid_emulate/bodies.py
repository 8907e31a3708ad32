"""Bodies on emulated devices: what real actuators would move, and what its tracker would measure.

The body is that of ``sim`` in the robot file, as on a simulated bus. It follows the true places of the
shafts and chambers, not what the devices report, and tendons pull on their servos in turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np

from contid.control.engine.wiring import simulated_bodies
from contid.control.tick.transmission import axis_map
from contid.hal import TipMeasured
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import LoadedFile
from contid.robot_file.tendon.robot import TendonRobot
from contid_emulate.dynamixel.bench import MA_PER_NM
from contid_emulate.dynamixel.body_tendons import BodyTendons, Spool
from contid_emulate.tracked_body import TrackedBody

#: Time between two looks at the devices.
LOOK_S: Final = 0.004


@runtime_checkable
class Actuates(Protocol):
    """Emulated devices whose shafts and chambers can be looked at."""

    def actuators(self, now_s: float) -> Mapping[str, float]:
        """True values of the axes [rad or Pa] at a time."""


@runtime_checkable
class Carries(Protocol):
    """Emulated devices on which the tendons of a body pull."""

    def carry(self, spools: Sequence[Spool]) -> BodyTendons:
        """The tendons of a body on these spools."""


@runtime_checkable
class PullsBack(Protocol):
    """A body whose tendons have tensions."""

    def tensions_n(self) -> Sequence[float]:
        """The present ones."""


@dataclass(slots=True)
class _Carried:
    """One body: its tendons on servos, if it has any."""

    tracked: TrackedBody
    tendons: BodyTendons | None


class EmulatedBodies:
    """The bodies of the robots of a file whose axes are all emulated; they move by given times only.

    Args:
        loaded: robot file.
        devices: emulated devices by the name of their bus.
        now_s: time of `time.monotonic`, or a virtual one; times of the robot file count from it.

    Attributes:
        lines: for the user: which bodies there are, and which not.
    """

    def __init__(self, loaded: LoadedFile, devices: Mapping[str, object], now_s: float) -> None:
        self._devices = [each for each in devices.values() if isinstance(each, Actuates)]
        self._began_s = self._looked_s = now_s
        self._seen: dict[str, float] = {}
        self._carried: list[_Carried] = []
        self.lines: list[str] = []
        for name, robot, buses in simulated_bodies(loaded):
            if not isinstance(robot, Cosserat | TendonRobot) or not buses & devices.keys():
                continue
            if strange := sorted(each for each in buses if not isinstance(devices.get(each), Actuates)):
                self.lines.append(f"{name}: no body, since bus {', '.join(strange)} is not emulated here")
                continue
            tracked = TrackedBody(name, robot)
            self._carried.append(_Carried(tracked, _tendons(name, robot, devices, tracked)))
            assert robot.sim is not None
            moving = "a moving body" if robot.sim.dynamics else "a body at rest at every instant"
            self.lines.append(f"{name}: {moving}, its tip measured at {robot.sim.tracker.rate_hz:g} Hz")

    def __bool__(self) -> bool:
        return bool(self._carried)

    def advance(self, now_s: float) -> list[TipMeasured]:
        """Look at the devices, move the bodies on to ``now_s``; measurements whose latency is over."""
        seen: dict[str, float] = {}
        for each in self._devices:
            seen.update(each.actuators(now_s))
        last = self._seen or seen
        arrived: list[TipMeasured] = []
        for carried in self._carried:
            tracked = carried.tracked
            while (capture_s := tracked.next_capture_s(self._began_s)) <= now_s:
                passed = (capture_s - self._looked_s) / max(now_s - self._looked_s, 1e-9)
                between = [last[axis] + passed * (seen[axis] - last[axis]) for axis in tracked.axes]
                tracked.capture(between, capture_s, capture_s - self._began_s)
            tracked.body.follow([seen[axis] for axis in tracked.axes], now_s - self._began_s)
            if carried.tendons is not None and isinstance(tracked.body, PullsBack):
                carried.tendons.tensions_n = np.array(tracked.body.tensions_n())
            arrived += tracked.take_arrived(now_s)
        self._seen, self._looked_s = seen, now_s
        return arrived


def _tendons(
    name: str, robot: Cosserat | TendonRobot, devices: Mapping[str, object], tracked: TrackedBody
) -> BodyTendons | None:
    """The body's tendons on the servos of the one bus that carries them all."""
    buses = {robot.axes[axis].bus for axis in robot.axis_names}
    bench = devices[next(iter(buses))]
    if len(buses) > 1 or not isinstance(bench, Carries) or not isinstance(tracked.body, PullsBack):
        return None
    return bench.carry(list(_spools(name, robot))) if isinstance(robot, TendonRobot) else None


def _spools(name: str, robot: TendonRobot) -> Iterator[Spool]:
    for axis, rest_m in zip(robot.axis_names, robot.rest, strict=False):
        to_device, to_driven = axis_map(robot.axes[axis])
        wound_m_per_rad = to_driven(1.0) - to_driven(0.0)
        yield Spool(f"{name}.{axis}", MA_PER_NM * wound_m_per_rad, to_device(rest_m))
