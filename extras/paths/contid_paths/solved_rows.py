"""What `contid ik` and `contid fk` do with rows of one robot, on the kernels for batches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from contid.api.placed import PlacedRows
from contid.api.units import Units
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.batch import Table, Targets, forward_many, inverse_many
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Bending, Model, build_model
from contid.robot_file.robot import RobotDescription
from contid.targets import Solution
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.columns import RobotColumns
from contid.units import MM_PER_M, m_to_mm
from contid_paths.converted_rows import CellBlock, RobotRows

_FILE_UNITS: Final = Units()


class InverseBlock(NamedTuple):
    """Inverse kinematics of a block.

    Attributes:
        actuation: shape ``(rows, axes)`` [m or Pa].
        residual_m: shape ``(rows,)``.
        reports: for each row, whether it converged, its limits, and iterations.
    """

    actuation: Array
    residual_m: Array
    reports: Sequence[tuple[bool, str, int]]


class InverseRows(RobotRows[InverseBlock]):
    """Actuation for targets; each row starts from the answer of the one before, the first from rest.

    Args:
        name: name of the robot.
        robot: its description.
        bare: only the columns that `contid fk` and `run` read; a row out of reach ends the conversion.
    """

    def __init__(self, name: str, robot: RobotDescription, bare: bool) -> None:
        self._name, self._robot, self._bare = name, robot, bare
        self._model = build_model(robot)
        self._frame = BaseFrame.of(robot.base)
        self._placed = PlacedRows(self._frame, robot.dimension)
        self._seed = robot.rest[: len(robot.axis_names)]

    def names(self, columns: RobotColumns) -> list[str]:
        """Columns of the result, without the robot's name in front (`RobotRows`)."""
        robot = self._robot
        axes = [f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names]
        if not self._bare:
            return [*axes, "residual_mm", "converged", "limited_by", "iterations"]
        units = dict(zip(robot.all_axis_names, robot.quantities, strict=True))
        axes += [f"{axis}_{units[axis].unit}" for axis, _ in columns.extra]
        return axes + [f"load.f{axis}_n" for axis in "xyz" if "load" in robot.accepts]

    def solve(self, columns: RobotColumns, rows: Array) -> InverseBlock:
        """The arithmetic; in a thread, while the block before is printed (`RobotRows`)."""
        if columns.actuation or columns.arcs or columns.x_axis:
            return self._one_by_one(columns, rows)
        placed, mids, directions, loads = self._placed, None, None, None
        if columns.mid:
            mids = placed.points_in_base(rows[:, columns.mid])
        if columns.direction:
            directions = placed.vectors_in_base(_unit_vectors(rows[:, columns.direction]))
        if columns.load:
            loads = placed.vectors_in_base(rows[:, columns.load])
        targets = Targets(placed.points_in_base(rows[:, columns.tip]), directions, mids, loads)
        found = inverse_many(self._model, targets, self._seed, chained=True)
        table = found.rows
        self._seed = tuple(table["actuation"][-1].tolist())
        kinds = zip(*np.unique(table["limited_by"], return_index=True), strict=True)
        limits = {int(bits): " ".join(found.limited_by(row)) for bits, row in kinds}
        named = [limits[bits] for bits in table["limited_by"].tolist()]
        reports = zip(table["converged"].tolist(), named, table["iterations"].tolist(), strict=True)
        return InverseBlock(table["actuation"], table["residual_m"], list(reports))

    def _one_by_one(self, columns: RobotColumns, rows: Array) -> InverseBlock:
        """Answers for actuations, bends and frames of the tip, which batches do not take."""
        found: list[Solution] = []
        for row in rows.tolist():
            target = self._frame.target_in_base(columns.target(row))
            found.append(self._model.inverse(target, self._seed))
            self._seed = found[-1].actuation
        return InverseBlock(
            np.array([each.actuation for each in found]),
            np.array([each.residual_m for each in found]),
            [(each.converged, " ".join(each.limited_by), each.iterations) for each in found],
        )

    def cells(self, columns: RobotColumns, rows: Array, answers: InverseBlock) -> list[CellBlock]:
        """The columns of the result (`RobotRows`)."""
        robot = self._robot
        values = [_FILE_UNITS.from_si(answers.actuation, robot.quantity)]
        if not self._bare:
            return [np.column_stack([*values, answers.residual_m * MM_PER_M]), answers.reports]
        quantities = dict(zip(robot.all_axis_names, robot.quantities, strict=True))
        values += [_FILE_UNITS.from_si(rows[:, index], quantities[axis]) for axis, index in columns.extra]
        if "load" in robot.accepts:
            values.append(rows[:, columns.load] if columns.load else np.zeros((len(rows), 3)))
        return [np.column_stack(values)]

    def refused(self, answers: InverseBlock) -> tuple[int, str] | None:
        """The first row that ends the conversion, and why; the first bare row out of reach (`RobotRows`)."""
        row = next((k for k, (converged, _, _) in enumerate(answers.reports) if not converged), None)
        if not self._bare or row is None:
            return None
        limits = f", limited by {answers.reports[row][1]}" if answers.reports[row][1] else ""
        away_mm = m_to_mm(float(answers.residual_m[row]))
        return row, f"{self._name}: out of reach by {away_mm:.6g} mm{limits}"


class ForwardRows(RobotRows[Table]):
    """Tips of actuations.

    Args:
        name: name of the robot.
        robot: its description.
        pose: also the direction of the tip and the mid-point.
        frame: also the direction and the x axis of the tip.
    """

    def __init__(self, name: str, robot: RobotDescription, pose: bool, frame: bool) -> None:
        self._name, self._robot = name, robot
        self._model = build_model(robot)
        self._placed = PlacedRows(BaseFrame.of(robot.base), robot.dimension)
        self._direction = pose or frame or "direction" in robot.accepts
        self._mid = pose and "mid" in robot.accepts
        self._frame = frame

    def names(self, columns: RobotColumns) -> list[str]:
        """Columns of the result, without the robot's name in front (`RobotRows`)."""
        printed = {"{}_mm": True, "a{}": self._direction, "b{}": self._frame, "mid.{}_mm": self._mid}
        axes = "xyz"[: self._robot.dimension]
        return [name.format(axis) for name, given in printed.items() if given for axis in axes]

    def solve(self, columns: RobotColumns, rows: Array) -> Table:
        """The arithmetic; in a thread, while the block before is printed (`RobotRows`)."""
        load = self._placed.vectors_in_base(rows[:, columns.load]) if columns.load else None
        return forward_many(
            self._model, _actuations(self._name, self._robot, self._model, columns, rows), load
        )

    def cells(self, columns: RobotColumns, rows: Array, answers: Table) -> list[CellBlock]:
        """The columns of the result (`RobotRows`)."""
        placed, poses = self._placed, answers
        values = [_FILE_UNITS.from_si(placed.points_in_world(poses["tip_m"]))]
        if self._direction:
            values.append(placed.vectors_in_world(poses["direction"]))
        if self._frame:
            values.append(placed.vectors_in_world(poses["rotation"][:, :, 0]))
        if self._mid:
            values.append(_FILE_UNITS.from_si(placed.points_in_world(poses["mid_m"])))
        return [np.column_stack(values)]


class ArcRows(RobotRows[Array]):
    """Bends and lengths of the sections of actuations.

    Args:
        name: name of the robot.
        robot: its description.

    Raises:
        ContidError: the sections of the robot have no bends of their own.
    """

    def __init__(self, name: str, robot: RobotDescription) -> None:
        self._name, self._robot = name, robot
        self._model = build_model(robot)
        if "arcs" not in robot.accepts or not isinstance(self._model, Bending):
            raise ContidError(f"{name}: the sections of model {robot.kinematics!r} have no bends to state")
        self._bends = self._model

    def names(self, columns: RobotColumns) -> list[str]:
        """Columns of the result, without the robot's name in front (`RobotRows`)."""
        return arc_names(self._robot)

    def solve(self, columns: RobotColumns, rows: Array) -> Array:
        """The arithmetic; in a thread, while the block before is printed (`RobotRows`)."""
        actuations = _actuations(self._name, self._robot, self._model, columns, rows)
        frame = BaseFrame.of(self._robot.base)
        arcs = (
            self._bends.arcs(tuple(row), frame.vector_in_base(columns.target(full).load_n))
            for row, full in zip(actuations.tolist(), rows.tolist(), strict=True)
        )
        return np.array([arc_values(self._robot, each.tolist()) for each in arcs])

    def cells(self, columns: RobotColumns, rows: Array, answers: Array) -> list[CellBlock]:
        """The columns of the result (`RobotRows`)."""
        return [answers]


def _actuations(
    name: str, robot: RobotDescription, model: Model, columns: RobotColumns, rows: Array
) -> Array:
    """The actuations that rows state, or those that have their bends, shape ``(rows, axes)`` [m or Pa].

    Raises:
        ValueError: they state neither.
    """
    if columns.arcs and isinstance(model, Bending):
        frame, rest = BaseFrame.of(robot.base), robot.rest
        targets = [frame.target_in_base(columns.target(row)) for row in rows.tolist()]
        return np.array([model.of_arcs(each.arcs or (), rest, each.load_n) for each in targets])
    if not columns.actuation:
        axes = ", ".join(f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names)
        raise ValueError(f"fk needs the actuation of {name}: {axes}")
    found: Array = rows[:, columns.actuation]
    return found


def _unit_vectors(given: Array) -> Array:
    """Vectors ``(rows, d)`` with length 1, rounded as those of a run are."""
    lengths = np.array([math.hypot(*vector) for vector in given.tolist()])
    found: Array = given / lengths[:, None]
    return found
