"""Motions that show how a robot moves: steps, sums of sines, a chirp and ring-downs, within its limits.

Axes are the robot's own; where every tendon has a motor, sections are bent instead, because tendons pull
against each other. Every part begins and ends at the same pose. It is made smaller, or slower, until the
check that `contid check` makes of a trajectory accepts it: reach, limits, speed, tension and clearance.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.engine.wiring import build_preflight
from contid.control.tick.preflight.rows import TooFastError, Unreachable
from contid.errors import BadInputError, ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.trajectory.columns import column_groups
from contid.trajectory.read import read_trajectory
from contid_identify.motions import KEEP_FREQUENCIES, KINDS, ROWS_HZ, Motion

#: Share of the travel of an axis that is used at most, and greatest bend of a section [rad].
_SHARE: Final = 0.6
_BEND_RAD: Final = math.radians(45.0)
#: Smaller or slower by this much per try, and the tries.
_STEP: Final = 0.75
_TRIES: Final = 16


@dataclass(frozen=True, slots=True)
class ExcitedPart:
    """One accepted part.

    Attributes:
        name: kind of motion.
        duration_s: of it.
        share: of the amplitude that was tried first.
        slowed: how much longer than tried first.
    """

    name: str
    duration_s: float
    share: float
    slowed: float


@dataclass(frozen=True, eq=False)
class ExcitingTrajectory:
    """An accepted trajectory.

    Attributes:
        text: CSV.
        parts: in order.
        columns: that move.
    """

    text: str
    parts: tuple[ExcitedPart, ...]
    columns: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Of the whole."""
        return sum(part.duration_s for part in self.parts)


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """What is moved: centre and amplitude of each coordinate, and the columns that they become."""

    columns: tuple[str, ...]
    centre: Array
    amplitude: Array
    to_columns: Callable[[Array], Array]


def exciting(
    loaded: LoadedFile, name: str, duration_s: float, kinds: Sequence[str], upper_hz: float, seed: int
) -> ExcitingTrajectory:
    """A trajectory that excites one robot of a file.

    Args:
        loaded: the file.
        name: of the robot.
        duration_s: about how long.
        kinds: parts in order, of `KINDS`.
        upper_hz: highest frequency.
        seed: of the random phases and orders.

    Raises:
        ContidError: no part of it is accepted, however small.
    """
    robot = loaded.driven[name]
    coordinates = _coordinates(robot, "" if len(loaded.driven) == 1 else f"{name}.")
    rng = np.random.default_rng(seed)
    count = len(coordinates.centre)
    rows, parts = [], []
    for kind in kinds:
        part_s = duration_s / len(kinds)
        motion = KINDS[kind](count, part_s, upper_hz, rng)
        found, part = _accepted(kind, motion, coordinates, loaded)
        rows.append(found)
        parts.append(part)
    text = _csv(np.vstack(rows), coordinates)
    _check(text, loaded)
    return ExcitingTrajectory(text, tuple(parts), coordinates.columns)


def _accepted(
    kind: str, motion: Motion, coordinates: _Coordinates, loaded: LoadedFile
) -> tuple[Array, ExcitedPart]:
    share, slowed = 1.0, 1.0
    last: BadInputError | None = None
    for _ in range(_TRIES):
        rows = share * motion(slowed)
        try:
            _check(_csv(rows, coordinates), loaded)
            return rows, ExcitedPart(kind, len(rows) / ROWS_HZ, share, slowed)
        except BadInputError as error:
            last = error
            if isinstance(error, TooFastError) and kind not in KEEP_FREQUENCIES:
                slowed /= _STEP
            else:
                share *= _STEP
    raise ContidError(f"no {kind} of {loaded.file.name} is accepted, however small: {last}")


def _check(text: str, loaded: LoadedFile) -> None:
    # A new one each time: what it solved before would be where the robots are.
    preflight = build_preflight(loaded, loaded.file.rate_hz, Unreachable.REFUSE)
    assert preflight is not None, "refusing always checks"
    preflight.trajectory(read_trajectory(io.StringIO(text), "excitation", loaded.driven), "excitation")


def _csv(rows: Array, coordinates: _Coordinates) -> str:
    values = coordinates.to_columns(coordinates.centre + coordinates.amplitude * rows)
    lines = ["t_s," + ",".join(coordinates.columns)]
    for k, row in enumerate(values):
        lines.append(f"{k / ROWS_HZ:.2f}," + ",".join(f"{value:.6g}" for value in row))
    return "\n".join(lines) + "\n"


def _coordinates(robot: RobotDescription, prefix: str) -> _Coordinates:
    groups = column_groups(prefix, robot)
    if isinstance(robot, TendonRobot) and robot.drives is None:
        return _bends([each for each in groups["arcs"] if each.endswith(("bend_deg", "azimuth_deg"))])
    count = len(robot.axis_names)
    low, high, rest = (np.array(each[:count]) for each in (robot.lower, robot.upper, robot.rest))
    half = 0.5 * _SHARE * (high - low)
    centre = np.clip(rest, low + half, high - half)
    unit = robot.quantity.to_si(1.0)
    return _Coordinates(tuple(groups["actuation"]), centre / unit, half / unit, lambda rows: rows)


def _bends(columns: Sequence[str]) -> _Coordinates:
    """Components of the bends of sections: rows ``(u1, v1, u2, v2, ..)`` [rad]."""

    def to_columns(rows: Array) -> Array:
        out = np.empty_like(rows)
        u, v = rows[:, 0::2], rows[:, 1::2]
        out[:, 0::2] = np.degrees(np.hypot(u, v))
        out[:, 1::2] = np.degrees(np.arctan2(v, u))
        return out

    count = len(columns)
    return _Coordinates(tuple(columns), np.zeros(count), np.full(count, _BEND_RAD), to_columns)
