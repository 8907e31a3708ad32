"""What numbers of a table cannot be those of its robot: limits, reach, tips that jump or move too early."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError, Located
from contid.kinematics.array import Array
from contid.kinematics.batch import forward_many
from contid.kinematics.model import build_model
from contid.robot_file.robot import RobotDescription
from contid.units import MM_PER_M
from contid_adapt.meaning.mapping import Mapping
from contid_adapt.reading.table import Table

#: Set-points this far outside of the limits of a robot, in shares of its range, have another unit.
_BEYOND: Final = 0.5
#: Tips this many times as far from the base as the model's can be have another unit or frame.
_FARTHEST: Final = 2.0
#: Share of the tips above which that is so of the table, not of single tips.
_MOST: Final = 0.5
#: Single tips are wrong that are farther from the median of five than this many times what this share of all
#: is at most, and this share of their extent.
_JUMP: Final = 5.0
_USUAL: Final = 0.95
_LEAST_JUMP: Final = 0.01
#: Of the way of a tip, what it moves by before the first set-point that changes.
_EARLY: Final = 0.05


@dataclass(frozen=True, eq=False)
class MeantRows:
    """Rows of a table whose columns have a meaning; ``rows`` is NaN where a cell is lost."""

    table: Table
    mapping: Mapping
    names: tuple[str, ...]
    times_s: Array
    rows: Array

    def column(self, name: str) -> Array | None:
        """One column, None where the mapping has none."""
        return self.rows[:, self.names.index(name)] if name in self.names else None

    def at(self, row: int, name: str, message: str) -> BadInputError:
        """A finding at the row, and at the line of the mapping that gives the column."""
        line = self.mapping.lines.get(name)
        found = [Located(self.mapping.file, line, 1, f"{name} is this one")] if line else []
        return BadInputError([self.table.at(row, None, message), *found])


def check_limits(of: MeantRows, robot: RobotDescription, sent: Array, first: int) -> None:
    """Refuse set-points that no such robot has."""
    for k, name in enumerate(robot.columns[: len(robot.axis_names)]):
        low, high = (robot.quantity.from_si(each[k]) for each in (robot.lower, robot.upper))
        beyond = _BEYOND * (high - low)
        out = (sent[:, k] < low - beyond) | (sent[:, k] > high + beyond)
        if out.any():
            row = int(np.argmax(out))
            raise of.at(
                row + first, name,
                f"{name} is {sent[row, k]:.4g}, but the limits of the robot are {low:.4g} to {high:.4g}: is "
                "its unit right, and are these limits those of the robot that was recorded?",
            )  # fmt: skip


def check_tips(of: MeantRows, robot: RobotDescription, tips: Array, rows: NDArray[np.intp]) -> None:
    """Refuse tips ``(n, 3)`` [m], base frame, most of which no such robot reaches, or that stand still.

    Args:
        of: the table that has them.
        robot: its description.
        tips: measured tips.
        rows: row of the table that each tip is from.
    """
    if not len(tips):
        return
    farthest_m = farthest_tip_m(robot)
    far = np.linalg.norm(tips, axis=1) > _FARTHEST * farthest_m
    if far.mean() > _MOST:
        row = int(np.argmax(far))
        off_mm = MM_PER_M * float(np.linalg.norm(tips[row]))
        raise of.at(
            int(rows[row]), "meas.x_mm",
            f"the tip is {off_mm:.4g} mm from the base, but that of the robot is at most about "
            f"{MM_PER_M * farthest_m:.4g} mm away: is its unit right? In the table of a camera the base "
            "stands elsewhere: take its place off, or write `frame: {origin: rest, at: rest}`",
        )  # fmt: skip
    if not np.ptp(tips, axis=0).any():
        raise ContidError(f"{of.table.file}: the measured tip never moves; are meas.x_mm .. its columns?")


def jumping(points: Array) -> NDArray[np.bool_]:
    """Which tips ``(n, 3)`` are far from the median of five about them, as single wrong frames are."""
    if len(points) < 5:
        return np.zeros(len(points), dtype=bool)
    padded = np.pad(points, ((2, 2), (0, 0)), mode="edge")
    middle = np.median(np.stack([padded[k : k + len(points)] for k in range(5)]), axis=0)
    apart = np.linalg.norm(points - middle, axis=1)
    usual = float(np.quantile(apart, _USUAL))
    return np.asarray(apart > _JUMP * usual + _LEAST_JUMP * float(np.ptp(points, axis=0).max()))


def moves_early(at_s: Array, sent: Array, tip_at_s: Array, tips: Array) -> str:
    """A warning where the tip moves before the first set-point that changes; "" where it does not."""
    first_s = at_s[int(np.argmax((sent != sent[0]).any(axis=1)))]
    own = tips[tip_at_s <= first_s]
    moved_m = float(np.ptp(own, axis=0).max()) if len(own) else 0.0
    if moved_m < _EARLY * np.ptp(tips, axis=0).max():
        return ""
    return (
        f"the tip moves by {MM_PER_M * moved_m:.3g} mm before the first set-point changes ({first_s:.3g} s): "
        "it begins in motion, and models begin at rest; begin recordings with a rest, or give measured axes "
        "(`meas.`)"
    )


def tip_at_rest(robot: RobotDescription) -> Array:
    """The tip ``(3,)`` [m] in the base frame."""
    return np.asarray(_tips(robot, [robot.rest])[0])


def farthest_tip_m(robot: RobotDescription) -> float:
    """About how far the tip can be from the base [m]: at rest, or with all axes at one end of their ranges.

    Racks and chambers are longest at their upper ends, perhaps many times as long as at rest; tendon robots
    are so at rest, where they are straight.
    """
    count = len(robot.axis_names)
    tips = _tips(robot, [robot.rest[:count], robot.lower[:count], robot.upper[:count]])
    return float(np.nanmax(np.linalg.norm(tips, axis=1)))


def _tips(robot: RobotDescription, actuations: Sequence[Sequence[float]]) -> Array:
    """The tips ``(n, 3)`` [m] in the base frame."""
    return np.asarray(forward_many(build_model(robot), np.array(actuations))["tip_m"])
