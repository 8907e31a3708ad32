"""Rows given to `contid.api.robot.Robot`: checked, in SI, in the base frame of the robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import (
    ArgumentError,
    Shape,
    as_directions,
    as_rotations,
    as_rows,
    as_rows_like,
)
from contid.api.placed import PlacedRows
from contid.api.units import Units
from contid.kinematics.array import Array
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Actuation, Vec3

#: Columns of a wrench.
WRENCH: Final = ("fx_n", "fy_n", "fz_n", "mx", "my", "mz")


class RowArguments:
    """Converts arguments of one robot; every method raises `ArgumentError` for wrong ones."""

    def __init__(
        self, name: str, robot: RobotDescription, units: Units, placed: PlacedRows, axes: tuple[str, ...]
    ) -> None:
        """Convert for a robot.

        Args:
            name: of the robot, for messages.
            robot: its description.
            units: of the arrays given.
            placed: its base frame.
            axes: columns of an actuation.
        """
        self._name = name
        self._robot = robot
        self._units = units
        self._placed = placed
        self._axes = axes

    @property
    def point_columns(self) -> tuple[str, ...]:
        """Columns of a position."""
        return tuple(f"{axis}_{self._units.length}" for axis in "xyz"[: self._robot.dimension])

    def _accept(self, kind: str) -> None:
        accepts = self._robot.accepts
        if kind not in accepts:
            allowed = ", ".join(sorted(accepts))
            message = f"model {self._robot.model} of {self._name} takes no {kind}; allowed: {allowed}"
            raise ArgumentError(f"{kind}: {message}")

    def actuations(self, actuation: ArrayLike) -> tuple[Array, Shape]:
        """Actuations [m or Pa], and the shape of the rows."""
        rows, shape = as_rows("actuation", actuation, self._axes)
        return self._units.to_si(rows, self._robot.quantity), shape

    def loads(self, load: ArrayLike | None, shape: Shape) -> Array | None:
        """Forces on the tip in the base frame [N], None for none."""
        if load is None:
            return None
        self._accept("load")
        return self._placed.vectors_in_base(as_rows_like("load", load, ("fx_n", "fy_n", "fz_n"), shape))

    def wrenches(self, what: str, given: ArrayLike | None, shape: Shape) -> list[list[float]]:
        """Wrenches in the base frame [N, N·m], one for each row."""
        rows = as_rows_like(what, np.zeros(6) if given is None else given, WRENCH, shape)
        force = self._placed.vectors_in_base(rows[:, :3])
        moment = self._placed.vectors_in_base(rows[:, 3:] / self._units.scale())
        pairs: list[list[float]] = np.hstack([force, moment]).tolist()
        return pairs

    def pairs(self, rows: Array, load: ArrayLike | None, shape: Shape) -> Iterator[tuple[Actuation, Vec3]]:
        """Actuation and load of every row, as a model takes them."""
        loads = self.loads(load, shape)
        forces: list[Vec3] = (
            [ZERO3] * len(rows) if loads is None else [(x, y, z) for x, y, z in loads.tolist()]
        )
        return zip(map(tuple, rows.tolist()), forces, strict=True)

    def directions(self, direction: ArrayLike, shape: Shape) -> Array:
        """Directions of the tip in the base frame."""
        self._accept("direction")
        columns = ("ax", "ay", "az")[: self._robot.dimension]
        return self._placed.vectors_in_base(as_directions("direction", direction, columns, shape))

    def rotations(self, rotation: ArrayLike, alone: bool, shape: Shape) -> Array:
        """Frames of the tip in the base frame, shape ``(rows, 3, 3)``."""
        self._accept("rotation")
        if not alone:
            raise ArgumentError("rotation: goes with a tip only; leave out direction and mid")
        turns = self._placed.columns_in_base(as_rotations("rotation", rotation, shape))
        if len(turns) and np.linalg.det(turns).min() < 0.0:
            raise ArgumentError("rotation: not the hand of this robot's frame (see `mirror` in its file)")
        return turns

    def mids(self, mid: ArrayLike, shape: Shape) -> Array:
        """Ends of the first section in the base frame [m]."""
        self._accept("mid")
        rows = as_rows_like("mid", mid, [f"mid.{name}" for name in self.point_columns], shape)
        return self._placed.points_in_base(self._units.to_si(rows))

    def seeds(self, seed: ArrayLike | None, shape: Shape) -> Array:
        """Where the search begins [m or Pa]; the rest pose for None."""
        robot = self._robot
        if seed is None:
            return np.array(robot.rest[: len(robot.axis_names)])
        return self._units.to_si(as_rows_like("seed", seed, self._axes, shape), robot.quantity)
