"""Measured axes and tips of the robots of a session, from what their devices reported.

A record has the angles and pressures of the devices; transmission and model of the recorded robot file make
axes and tips of them, with the commanded load.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.tick_layout import RecordLayout
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.errors import SessionError
from contid.kinematics.array import Array
from contid.targets import Actuation, Vec3
from contid.units import MM_PER_M
from contid_sessions.columns import RecordedTicks

_TIP: Final = ("x_mm", "y_mm", "z_mm")
_NO_TIP: Final = (math.nan, math.nan, math.nan)


class MeasuredPose(NamedTuple):
    """What a robot did in one tick.

    Attributes:
        actuation: values of its axes [m or Pa], NaN where the device of an axis has no value.
        tip_m: tip in the world frame [m]; None while one of the axes is NaN.
    """

    actuation: Actuation
    tip_m: Vec3 | None


@dataclass(frozen=True)
class MeasuredRobot:
    """Measured axes and tip of one robot.

    Attributes:
        config: model, transmission and frame of the robot.
        device_slots: indices of its devices' values among the flat numbers of a record.
        load_slots: indices of the three components of the load that was commanded with the target.
    """

    config: RobotConfig
    device_slots: tuple[int, ...]
    load_slots: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The columns, in the order of `row`."""
        pairs = zip(self.config.axis_names, self.config.quantities, strict=True)
        axes = (f"{axis}_{quantity.unit}" for axis, quantity in pairs)
        return tuple(f"{self.config.name}.{name}" for name in (*axes, *_TIP))

    def pose(self, record: Sequence[float]) -> MeasuredPose:
        """The measured pose in a record, given as its flat numbers."""
        config = self.config
        actuation = config.transmission.to_actuation(tuple([record[slot] for slot in self.device_slots]))
        if not all(map(math.isfinite, actuation)):
            return MeasuredPose(actuation, None)
        x, y, z = (record[slot] for slot in self.load_slots)
        return MeasuredPose(actuation, tip_in_world(config, actuation, (x, y, z)))

    def row(self, record: Sequence[float]) -> tuple[float, ...]:
        """Axes and tip in the world, in the units of `names`; NaN for what is absent."""
        actuation, tip_m = self.pose(record)
        quantities = self.config.quantities
        axes = tuple([quantity.from_si(value) for quantity, value in zip(quantities, actuation, strict=True)])
        return (*axes, *(MM_PER_M * value for value in tip_m or _NO_TIP))


def measured_robots(session: RecordedTicks) -> list[MeasuredRobot]:
    """The robots of a session by its recorded robot file; none if this version of contid refuses the file."""
    try:
        configs = build_robot_configs(session.robot_file(), session.rate_hz)
    except SessionError:
        return []
    return [_measured_robot(session.layout, config) for config in configs if config.name in session.robots]


def _measured_robot(layout: RecordLayout, config: RobotConfig) -> MeasuredRobot:
    """A robot and where its values are in the records of a session."""
    index = [robot.name for robot in layout.robots].index(config.name)
    device_slots = tuple(layout.axis_place(index, axis, "value") for axis in range(len(config.axis_names)))
    load_slot = layout.robot_place(index, "load_n")
    return MeasuredRobot(config, device_slots, (load_slot, load_slot + 1, load_slot + 2))


def measured_block(robots: Sequence[MeasuredRobot], records: Sequence[Sequence[float]]) -> Array:
    """Measured axes and tips of all robots, in the units of their columns, a row per record."""
    rows = [[value for robot in robots for value in robot.row(record)] for record in records]
    return np.array(rows, dtype=np.float64).reshape(len(records), -1)
