"""What `Sim.step` returns: the robots after a tick, from its record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.api.units import Units
from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.tick_layout import CONVERGED, HAS_TARGET, RecordLayout, RobotRecord
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.kinematics.array import Array

_NO_TIP: Final = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class SimRobot:
    """One robot after a tick.

    Attributes:
        mode: ``APPROACH`` (on its way to the first target), ``RUN``, ``HOLD``, ``FAULT``, ...
        fault: number of the latched fault, 0 without; `contid fault NUMBER` explains it.
        command: actuation commanded in this tick, extra axes last.
        measured: actuation that the simulated devices reported.
        tip: tip of the measured actuation, world frame; columns x, y and for spatial robots z.
        residual: distance between the target and what the solution reaches; NaN without a target.
        converged: the solution meets the target.
        refused: why the last target was refused; the robot holds. "" otherwise.
    """

    mode: str
    fault: int
    command: Array
    measured: Array
    tip: Array
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


@dataclass(frozen=True, slots=True)
class StateReader:
    """Turns the values of a tick's record into a `SimState`."""

    layout: RecordLayout
    configs: Sequence[RobotConfig]
    units: Units

    def read(self, values: Sequence[float], refused: Mapping[str, str]) -> SimState:
        """The state after the tick of a record; ``refused`` has the reasons by robot."""
        record = self.layout.decode(tuple(values))
        robots = {
            config.name: self._robot(config, robot, refused.get(config.name, ""))
            for config, robot in zip(self.configs, record.robots, strict=True)
        }
        return SimState(record.tick, record.tick / self.layout.rate_hz, robots)

    def _robot(self, config: RobotConfig, record: RobotRecord, refused: str) -> SimRobot:
        units = self.units
        measured = config.transmission.to_actuation(tuple(axis.value for axis in record.axes))
        tip = None
        if all(map(math.isfinite, measured)):
            tip = tip_in_world(config, measured, record.load_n)
        return SimRobot(
            mode=Mode(record.mode).name,
            fault=int(record.fault),
            command=self._edge(config, [axis.command for axis in record.axes]),
            measured=self._edge(config, measured),
            tip=units.from_si(np.array((tip or _NO_TIP)[: config.model.dimension])),
            residual=float(units.from_si(np.array(record.residual_m))),
            converged=bool(record.flags & HAS_TARGET and record.flags & CONVERGED),
            refused=refused,
        )

    def _edge(self, config: RobotConfig, values: Sequence[float]) -> Array:
        """Values of all axes, each in its unit."""
        pairs = zip(values, config.quantities, strict=True)
        return np.array([float(self.units.from_si(np.array(value), each)) for value, each in pairs])
