"""What `Sim.step` returns: the robots after a tick, from its record."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from contid.api.units import Units
from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.tick_layout import CONVERGED, HAS_TARGET, TICK, RecordLayout
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.kinematics.array import Array

_NO_TIP: Final = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class SimRobot:
    """One robot after a tick, in the units of the library (`contid.api.units.Units`).

    Axes have the unit of their quantity each, ``mm``, ``bar`` or ``deg``, tips and distances that of lengths,
    ``mm``; with ``si=True`` they are in m, Pa and rad.

    Attributes:
        mode: ``APPROACH`` (on its way to the first target), ``RUN``, ``HOLD``, ``FAULT``, ...
        fault: number of the latched fault, 0 without; `contid fault NUMBER` explains it.
        command: actuation commanded in this tick, extra axes last.
        measured: actuation that the simulated devices reported.
        tip: tip of the measured actuation, world frame; columns x, y and for spatial robots z.
        tracked: tip that a simulated tracker measured within the last second, likewise; NaN without one.
        residual: distance between the target and what the solution reaches; NaN without a target.
        converged: the solution meets the target.
        refused: why the last target was refused; the robot holds. "" otherwise.
    """

    mode: str
    fault: int
    command: Array
    measured: Array
    tip: Array
    tracked: Array
    residual: float
    converged: bool
    refused: str


@dataclass(frozen=True, eq=False)
class SimState:
    """All robots after a tick.

    Attributes:
        tick: its number.
        time_s: virtual time.
        robots: robots by name; ``state["left"]`` is short for ``state.robots["left"]``.
    """

    tick: int
    time_s: float
    robots: Mapping[str, SimRobot]

    def __getitem__(self, robot: str) -> SimRobot:
        """A robot by name."""
        return self.robots[robot]


class SimRobots(Mapping[str, SimRobot]):
    """The robots of a tick; one that is not looked at is not computed."""

    def __init__(self, readers: Mapping[str, Callable[[], SimRobot]]) -> None:
        self._readers = readers
        self._read: dict[str, SimRobot] = {}

    def __getitem__(self, robot: str) -> SimRobot:
        """A robot by name."""
        if robot not in self._read:
            self._read[robot] = self._readers[robot]()
        return self._read[robot]

    def __iter__(self) -> Iterator[str]:
        """Names."""
        return iter(self._readers)

    def __len__(self) -> int:
        """How many."""
        return len(self._readers)

    def __repr__(self) -> str:
        """As a dictionary."""
        return repr(dict(self))

    def __reduce__(self) -> tuple[type[dict[str, SimRobot]], tuple[dict[str, SimRobot]]]:
        """A copy for another process is a dictionary: compiled models cannot be copied."""
        return dict, (dict(self),)


@dataclass(frozen=True, slots=True)
class StateReader:
    """Turns the values of a tick's record into a `SimState`."""

    layout: RecordLayout
    configs: Sequence[RobotConfig]
    units: Units

    def read(self, values: Sequence[float], refused: Mapping[str, str]) -> SimState:
        """The state after the tick of a record; ``refused`` has the reasons by robot."""
        robots = {
            config.name: partial(self._robot, index, values, refused.get(config.name, ""))
            for index, config in enumerate(self.configs)
        }
        tick = int(values[TICK])
        return SimState(tick, tick / self.layout.rate_hz, SimRobots(robots))

    def mode(self, values: Sequence[float], index: int) -> Mode:
        """The mode of a robot of a record."""
        return Mode(int(values[self.layout.robot_place(index, "mode")]))

    def _robot(self, index: int, values: Sequence[float], refused: str) -> SimRobot:
        units, config = self.units, self.configs[index]
        record = self.layout.robot(values, index)
        measured = config.transmission.to_actuation(tuple(axis.value for axis in record.axes))
        tip = None
        if all(map(math.isfinite, measured)):
            tip = tip_in_world(config, measured, record.load_n)
        return SimRobot(
            mode=Mode(record.mode).name,
            fault=int(record.fault),
            command=self._in_user_units(config, [axis.command for axis in record.axes]),
            measured=self._in_user_units(config, measured),
            tip=units.from_si(np.array((tip or _NO_TIP)[: config.model.dimension])),
            tracked=units.from_si(np.array(record.measured_tip_m[: config.model.dimension])),
            residual=float(units.from_si(np.array(record.residual_m))),
            converged=bool(record.flags & HAS_TARGET and record.flags & CONVERGED),
            refused=refused,
        )

    def _in_user_units(self, config: RobotConfig, values: Sequence[float]) -> Array:
        """Values of all axes, each in its unit."""
        pairs = zip(values, config.quantities, strict=True)
        return np.array([float(self.units.from_si(np.array(value), each)) for value, each in pairs])
