"""``contid ik`` and ``contid fk`` for blocks of rows, on the kernels for batches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from contid.cli.support.row_blocks import joined, unit_vectors, vectors
from contid.cli.support.rows import column_prefix
from contid.kinematics.array import Array
from contid.kinematics.batch import Poses, Solutions, Targets, forward_many, inverse_many
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation, Target
from contid.trajectory.columns import ColumnLayout, RobotColumns
from contid.units import BAR, MM_PER_M


@dataclass(frozen=True, eq=False)
class SolvedBlock:
    """Rows of a block in SI and the answers of each robot."""

    layout: ColumnLayout
    rows: Array
    answers: Mapping[str, Solutions]


class InverseRows:
    """Answers for rows of tips; each row starts from the answer of the one before."""

    def __init__(
        self,
        loaded: LoadedFile,
        robots: Mapping[str, RobotDescription],
        models: Mapping[str, Model],
        seeds: dict[str, Actuation],
        bare: bool,
    ) -> None:
        self._loaded, self._robots, self._models, self._bare = loaded, robots, models, bare
        self._frames = {name: BaseFrame.of(robot.base) for name, robot in robots.items()}
        self._seeds = seeds

    def header(self, layout: ColumnLayout) -> tuple[str, ...] | None:
        """See `ManyRows`; rows of actuation go one by one."""
        if any(columns.actuation for columns in layout.robots):
            return None
        names = ["t_s"] if layout.time is not None else []
        for columns in layout.robots:
            robot, here = self._robots[columns.robot], column_prefix(self._loaded, columns.robot)
            unit = robot.quantity.unit
            names += [f"{here}{axis}_{unit}" for axis in robot.axis_names]
            if self._bare:
                units = dict(zip(robot.all_axis_names, robot.quantities, strict=True))
                names += [f"{here}{axis}_{units[axis].unit}" for axis, _ in columns.extra]
                names += [f"{here}load.f{axis}_n" for axis in "xyz" if "load" in robot.accepts]
            else:
                names += [
                    f"{here}{name}" for name in ("residual_mm", "converged", "limited_by", "iterations")
                ]
        return tuple(names)

    def solve(self, layout: ColumnLayout, rows: Array) -> SolvedBlock:
        """See `ManyRows`."""
        answers = {}
        for columns in layout.robots:
            name = columns.robot
            targets = targets_in_base(self._frames[name], columns, rows)
            found = inverse_many(self._models[name], targets, self._seeds[name], chained=True)
            self._seeds[name] = tuple(found.rows["actuation"][-1].tolist())
            answers[name] = found
        return SolvedBlock(layout, rows, answers)

    def lines(self, solved: object) -> tuple[list[str], str]:
        """See `ManyRows`; a bare row out of reach ends the conversion."""
        assert isinstance(solved, SolvedBlock)
        layout, rows = solved.layout, solved.rows
        parts = [] if layout.time is None else [joined(rows[:, [layout.time]])]
        end, message = len(rows), ""
        for columns in layout.robots:
            robot, found = self._robots[columns.robot], solved.answers[columns.robot]
            values = _edge(robot, found.rows["actuation"])
            residuals = found.rows["residual_m"] * MM_PER_M
            if not self._bare:
                parts += [joined(np.column_stack([values, residuals])), _reports(found)]
                continue
            away = np.flatnonzero(~found.rows["converged"])
            if len(away) and away[0] < end:
                end, message = int(away[0]), _away(columns.robot, found, int(away[0]))
            extra = _edge(robot, rows[:, [index for _, index in columns.extra]])
            load = [vectors(rows, columns.load)] if "load" in robot.accepts else []
            parts.append(joined(np.column_stack([values, extra, *load])))
        return list(map(",".join, zip(*parts, strict=True)))[:end], message


class ForwardRows:
    """Tips for rows of actuation."""

    def __init__(
        self,
        loaded: LoadedFile,
        robots: Mapping[str, RobotDescription],
        models: Mapping[str, Model],
        pose: bool,
        frame: bool = False,
    ) -> None:
        self._loaded, self._robots, self._models = loaded, robots, models
        self._pose, self._frame = pose, frame
        self._frames = {name: BaseFrame.of(robot.base) for name, robot in robots.items()}

    def header(self, layout: ColumnLayout) -> tuple[str, ...] | None:
        """See `ManyRows`; rows of tips go one by one, to their mistake."""
        if not all(columns.actuation for columns in layout.robots):
            return None
        names = ["t_s"] if layout.time is not None else []
        for columns in layout.robots:
            here, axes = column_prefix(self._loaded, columns.robot), self._axes(columns)
            names += [f"{here}{axis}_mm" for axis in axes]
            direction, mid = self._more(columns)
            names += [f"{here}a{axis}" for axis in axes if direction]
            names += [f"{here}b{axis}" for axis in axes if self._frame]
            names += [f"{here}mid.{axis}_mm" for axis in axes if mid]
        return tuple(names)

    def solve(self, layout: ColumnLayout, rows: Array) -> tuple[ColumnLayout, Array, Mapping[str, Poses]]:
        """See `ManyRows`."""
        found = {}
        for columns in layout.robots:
            frame, model = self._frames[columns.robot], self._models[columns.robot]
            load = vectors_in_base(frame, vectors(rows, columns.load)) if columns.load else None
            found[columns.robot] = forward_many(model, rows[:, columns.actuation], load)
        return layout, rows, found

    def lines(self, solved: object) -> tuple[list[str], str]:
        """See `ManyRows`."""
        assert isinstance(solved, tuple)
        layout, rows, found = solved
        parts = [] if layout.time is None else [joined(rows[:, [layout.time]])]
        for columns in layout.robots:
            frame, poses = self._frames[columns.robot], found[columns.robot].rows
            count = len(self._axes(columns))
            direction, mid = self._more(columns)
            values = [points_in_world(frame, poses["tip_m"])[:, :count] * MM_PER_M]
            if direction:
                values.append(_turned(frame, poses["direction"])[:, :count])
            if self._frame:
                values.append(_turned(frame, poses["rotation"][:, :, 0]))
            if mid:
                values.append(points_in_world(frame, poses["mid_m"])[:, :count] * MM_PER_M)
            parts.append(joined(np.column_stack(values)))
        return list(map(",".join, zip(*parts, strict=True))), ""

    def _axes(self, columns: RobotColumns) -> str:
        return "xyz"[: self._models[columns.robot].dimension]

    def _more(self, columns: RobotColumns) -> tuple[bool, bool]:
        """Whether the direction and the mid-point are printed."""
        accepts = self._robots[columns.robot].accepts
        return self._pose or self._frame or "direction" in accepts, self._pose and "mid" in accepts


def targets_in_base(frame: BaseFrame, columns: RobotColumns, rows: Array) -> Targets:
    """Targets of a block as a model takes them; each sum in the order of `BaseFrame`."""
    x, y, z = vectors(rows, columns.tip).T
    a, b, c = frame.origin_in_world
    tips = vectors_in_base(frame, np.column_stack([x - a, y - b, z - c]))
    mids = load = direction = None
    if columns.mid:
        mids = vectors_in_base(frame, vectors(rows, columns.mid) - frame.origin_in_world)
    if columns.direction:
        direction = vectors_in_base(frame, unit_vectors(vectors(rows, columns.direction)))
    if columns.load:
        load = vectors_in_base(frame, vectors(rows, columns.load))
    targets = Targets.of(tips, direction, mids, load)
    if not columns.x_axis:
        return targets
    frames = np.empty((len(rows), 3, 3))
    for k, row in enumerate(rows.tolist()):
        turn = columns.rotation(row)
        assert turn is not None  # the reader refuses such rows
        in_base = frame.target_in_base(Target(rotation=turn)).rotation
        frames[k] = np.reshape(in_base or turn, (3, 3))
    return replace(targets, direction=None, rotation=frames)


def vectors_in_base(frame: BaseFrame, given: Array) -> Array:
    """`BaseFrame.vector_in_base` of every row."""
    (x, y, z), r = given.T, frame.rotation
    return np.column_stack([r[k] * x + r[3 + k] * y + r[6 + k] * z for k in range(3)])


def points_in_world(frame: BaseFrame, given: Array) -> Array:
    """`BaseFrame.point_in_world` of every row."""
    moved: Array = _turned(frame, given) + frame.origin_in_world
    return moved


def _turned(frame: BaseFrame, given: Array) -> Array:
    (x, y, z), r = given.T, frame.rotation
    return np.column_stack([r[3 * k] * x + r[3 * k + 1] * y + r[3 * k + 2] * z for k in range(3)])


def _edge(robot: RobotDescription, values: Array) -> Array:
    """`Quantity.from_si` of every value."""
    found: Array = values * MM_PER_M if robot.quantity is Quantity.LENGTH else values / BAR
    return found


def _reports(found: Solutions) -> list[str]:
    """``converged,limited_by,iterations`` of every row."""
    names = found.limit_names

    @lru_cache(maxsize=4096)
    def text(converged: bool, bits: int, iterations: int) -> str:
        limits = " ".join(name for k, name in enumerate(names) if bits >> k & 1)
        return f"{'true' if converged else 'false'},{limits},{iterations}"

    rows = found.rows
    return list(
        map(text, rows["converged"].tolist(), rows["limited_by"].tolist(), rows["iterations"].tolist())
    )


def _away(name: str, found: Solutions, row: int) -> str:
    """Why a bare row is refused."""
    limited = found.limited_by(row)
    limits = f", limited by {' '.join(limited)}" if limited else ""
    return f"{name}: out of reach by {float(found.rows['residual_m'][row]) * MM_PER_M:.6g} mm{limits}"
