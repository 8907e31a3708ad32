"""Rows given to `contid.api.robot.Robot`, checked, in SI, in its base frame; and rows of its results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import (
    ArgumentError,
    GivenRows,
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


@dataclass(frozen=True)
class RowArguments:
    """Converts arguments of one robot; every method raises `ArgumentError` for wrong ones.

    Attributes:
        name: name of the robot, for messages.
        robot: its description.
        units: units of the arrays given.
        placed: its base frame.
        axes: columns of an actuation.
    """

    name: str
    robot: RobotDescription
    units: Units
    placed: PlacedRows
    axes: tuple[str, ...]

    @cached_property
    def _rest(self) -> Array:
        """Rest pose of the axes [m or Pa]."""
        return np.array(self.robot.rest[: len(self.axes)])

    @cached_property
    def point_columns(self) -> tuple[str, ...]:
        """Columns of a position."""
        return tuple(f"{axis}_{self.units.length}" for axis in "xyz"[: self.robot.dimension])

    def _accept(self, kind: str) -> None:
        accepts = self.robot.accepts
        if kind not in accepts:
            allowed = ", ".join(sorted(accepts))
            message = f"model {self.robot.model} of {self.name} takes no {kind}; allowed: {allowed}"
            raise ArgumentError(f"{kind}: {message}")

    def actuations(self, actuation: ArrayLike) -> GivenRows:
        """Actuations [m or Pa]."""
        rows, shape = as_rows("actuation", actuation, self.axes)
        return GivenRows(self.units.to_si(rows, self.robot.quantity), shape)

    def loads(self, load: ArrayLike | None, shape: Shape) -> Array | None:
        """Forces on the tip in the base frame [N], None for none."""
        if load is None:
            return None
        self._accept("load")
        return self.placed.vectors_in_base(as_rows_like("load", load, ("fx_n", "fy_n", "fz_n"), shape))

    def wrenches(self, what: str, given: ArrayLike | None, shape: Shape) -> list[list[float]]:
        """Wrenches in the base frame [N, N·m], one for each row."""
        rows = as_rows_like(what, np.zeros(6) if given is None else given, WRENCH, shape)
        force = self.placed.vectors_in_base(rows[:, :3])
        moment = self.placed.vectors_in_base(rows[:, 3:] / self.units.scale())
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
        columns = ("ax", "ay", "az")[: self.robot.dimension]
        return self.placed.vectors_in_base(as_directions("direction", direction, columns, shape))

    def rotations(self, rotation: ArrayLike, alone: bool, shape: Shape) -> Array:
        """Frames of the tip in the base frame, shape ``(rows, 3, 3)``."""
        self._accept("rotation")
        if not alone:
            raise ArgumentError("rotation: goes with a tip only; leave out direction and mid")
        turns = self.placed.columns_in_base(as_rotations("rotation", rotation, shape))
        if len(turns) and np.linalg.det(turns).min() < 0.0:
            raise ArgumentError("rotation: not the hand of this robot's frame (see `mirror` in its file)")
        return turns

    def mids(self, mid: ArrayLike, shape: Shape) -> Array:
        """Ends of the first section in the base frame [m]."""
        self._accept("mid")
        rows = as_rows_like("mid", mid, [f"mid.{name}" for name in self.point_columns], shape)
        return self.placed.points_in_base(self.units.to_si(rows))

    def seeds(self, seed: ArrayLike | None, shape: Shape) -> Array:
        """Where the search begins [m or Pa]; the rest pose for None."""
        if seed is None:
            return self._rest.copy()
        return self.units.to_si(as_rows_like("seed", seed, self.axes, shape), self.robot.quantity)


#: A structured array with its fields as attributes.
Records: TypeAlias = "np.recarray[Any, np.dtype[np.record]]"


def records(shape: tuple[int, ...], **fields: Any) -> Records:
    """A record array of that shape from arrays with one entry per row."""
    layout = [(name, values.dtype, values.shape[1:]) for name, values in fields.items()]
    table = np.empty(int(np.prod(shape, dtype=int)), dtype=layout)
    for name, values in fields.items():
        table[name] = values
    return table.reshape(shape).view(np.recarray)


def renamed(table: np.ndarray[Any, Any], shape: tuple[int, ...], **fields: str) -> Records:
    """A table's own memory as a record array of that shape; each field with the name that it has there."""
    types = table.dtype.fields
    assert types is not None
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": [types[own][0] for own in fields.values()],
            "offsets": [types[own][1] for own in fields.values()],
            "itemsize": table.dtype.itemsize,
        }
    )
    return table.view(layout).reshape(shape).view(np.recarray)
