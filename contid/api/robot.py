"""`Robot`: kinematics of the robots of a file over arrays, in the world frame.

Units are those of robot files (mm, bar, N), or SI with ``si=True``.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import ArgumentError, Shape, as_rows, as_values
from contid.api.described import DescribedRobots
from contid.api.placed import PlacedRows
from contid.api.results import AnswerRecords, PoseRecords
from contid.api.row_arguments import RowArguments, records, renamed
from contid.api.workspace import Workspace, measure_workspace
from contid.entry_points import WORKSPACES, required
from contid.kinematics.array import Array
from contid.kinematics.batch import POSE, Solutions, Table, Targets, forward_many, inverse_many
from contid.kinematics.batch.loop import inverse_each
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Bending, Compliant, Model, UnderWrenches, build_model
from contid.robot_file.base import Quantity
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.rows import RowReader

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Start of the search of a row: given, the rest pose (None), or the answer of the row before.
Seed = ArrayLike | Literal["previous"] | None


class Robot(DescribedRobots):
    """The robots of a robot file; with several, index it by name: ``Robot("hand")["left"]``.

    Arrays have one row per target or actuation: ``(N, columns)``, one row ``(columns,)``, or any shape in
    front of the columns. Positions are in the world frame of the robot file.

    Args:
        file: a robot file, or the name of a shipped one.
        si: m and Pa instead of mm and bar.

    Attributes:
        names: names of the robots with actuators.
        units: units of all arrays.

    Raises:
        ContidError: no such file or name; the file has mistakes; the kernels are not compiled.
    """

    @cached_property
    def _model(self) -> Model:
        return build_model(self.description)

    @cached_property
    def _placed(self) -> PlacedRows:
        return PlacedRows(BaseFrame.of(self.description.base), self.dimension)

    @cached_property
    def _rows(self) -> RowArguments:
        return RowArguments(self.name, self.description, self.units, self._placed, self.axes)

    # -- kinematics --------------------------------------------------------------------------------------

    def fk(self, actuation: ArrayLike, *, load: ArrayLike | None = None) -> PoseRecords:
        """Forward kinematics (or statics): tips of actuations.

        Args:
            actuation: columns `axes`.
            load: known force on the tip [N], columns x, y, z; for models that bend under it.

        Returns:
            Structured array, one entry per row: ``tip``, ``direction`` (unit tangent at the tip), ``mid``
            (end of the first section), ``rotation`` (tip frame in the world, 3x3), ``stable`` (False for a
            buckled rod).

        Raises:
            ArgumentError: wrong shape, not finite, or a load on a model without.
        """
        rows, shape = self._rows.actuations(actuation)
        poses = forward_many(self._model, rows, self._rows.loads(load, shape))
        return self._pose_records(poses, shape)

    def fk_under(
        self, actuation: ArrayLike, *, tip: ArrayLike | None = None, mid: ArrayLike | None = None
    ) -> PoseRecords:
        """Forward statics under wrenches on the tip and on the end of the first section.

        Args:
            actuation: columns `axes`.
            tip: wrench on the tip, columns fx, fy, fz [N], mx, my, mz [N·mm; SI: N·m]; dead, world frame.
            mid: the same on the end of the first section.

        Returns:
            As `fk`. Under a moment ``stable`` is whether the arm gets there without a jump as the loads
            grow: a dead moment has no energy.

        Raises:
            ArgumentError: wrong shape, not finite, or a model that does not bend under wrenches.
        """
        rows, shape = self._rows.actuations(actuation)
        model = self._model
        if not isinstance(model, UnderWrenches):
            kind = self.description.model
            raise ArgumentError(f"fk_under: model {kind} of {self.name} does not bend under wrenches")
        wrenches = [self._rows.wrenches(what, given, shape) for what, given in (("tip", tip), ("mid", mid))]
        poses = np.zeros(len(rows), POSE)
        for number, (row, *under) in enumerate(zip(rows.tolist(), *wrenches, strict=True)):
            pose = model.forward_under(tuple(row), *map(tuple, under))
            rotation = np.reshape(pose.rotation, (3, 3))
            poses[number] = (pose.tip_m, rotation, pose.direction, pose.mid_m, pose.stable)
        return self._pose_records(poses, shape)

    def _pose_records(self, poses: Table, shape: Shape) -> PoseRecords:
        """What `fk` returns."""
        placed, units = self._placed, self.units
        found = records(
            shape,
            tip=units.from_si(placed.points_in_world(poses["tip_m"])),
            direction=placed.vectors_in_world(poses["direction"]),
            mid=units.from_si(placed.points_in_world(poses["mid_m"])),
            rotation=placed.columns_in_world(poses["rotation"]),
            stable=poses["stable"],
        )
        return found.view(PoseRecords)

    def ik(
        self,
        tips: ArrayLike,
        *,
        direction: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        mid: ArrayLike | None = None,
        load: ArrayLike | None = None,
        seed: Seed = None,
    ) -> AnswerRecords:
        """Inverse kinematics: actuations inside the limits whose tips are nearest to the targets.

        Args:
            tips: columns x, y and, for spatial robots, z.
            direction: direction of the body at its tip; its length does not matter. One row is for all tips.
            rotation: frame of the tip instead of a direction, as `fk` gives it: matrices ``(..., 3, 3)``.
                With the tip it fixes six numbers; for spatial arms with that many axes or bends.
            mid: position of the end of the first section.
            load: known force on the tip [N], columns x, y, z.
            seed: where the search begins, columns `axes`; None: the rest pose, for every row by itself;
                ``"previous"``: the answer of the row before, for rows that are a path.

        Returns:
            Structured array, one entry per row: ``actuation`` (columns `axes`), ``residual`` (distance to the
            target), ``converged``, ``limited_by`` (bits, see `limits_in`), ``iterations``. A target out of
            reach is an entry with ``converged`` False.

        Raises:
            ArgumentError: wrong shape, not finite, or a kind of target that the model does not take.
        """
        points, shape = as_rows("tips", tips, self._rows.point_columns)
        tasks = Targets(
            self._placed.points_in_base(self.units.to_si(points)),
            None if direction is None else self._rows.directions(direction, shape),
            None if mid is None else self._rows.mids(mid, shape),
            self._rows.loads(load, shape),
            None
            if rotation is None
            else self._rows.rotations(rotation, direction is None and mid is None, shape),
        )
        follow = isinstance(seed, str)
        if follow and seed != "previous":
            raise ArgumentError(f"seed={seed!r}; allowed: an array, None, 'previous'")
        seeds = self._rows.seeds(None if follow else seed, shape)
        return self._answers(inverse_many(self._model, tasks, seeds, chained=follow), shape)

    def _answers(self, answers: Solutions, shape: Shape) -> AnswerRecords:
        """What `ik` returns."""
        # The answers' own memory: a million rows are 70 MB.
        found = answers.rows
        self.units.change_from_si(found["actuation"], self.description.quantity)
        self.units.change_from_si(found["residual_m"])
        found["limited_by"] = self._bits.translated(answers)
        found = renamed(
            found,
            shape,
            actuation="actuation",
            residual="residual_m",
            converged="converged",
            limited_by="limited_by",
            iterations="iterations",
        )
        return found.view(AnswerRecords)

    @property
    def bend_columns(self) -> tuple[str, ...]:
        """Columns of the bends of the sections: ``s1.bend_deg, s1.azimuth_deg, s1.length_mm``, or in SI.

        Empty for a robot whose sections have no bends that a target may state.
        """
        names = arc_names(self.description)
        if not self.units.si:
            return tuple(names)
        return tuple(name.replace("_deg", "_rad").replace("_mm", "_m") for name in names)

    def bends(self, actuation: ArrayLike, *, load: ArrayLike | None = None) -> Array:
        """Bends of the sections at actuations, columns `bend_columns`.

        Args:
            actuation: columns `axes`.
            load: known force on the tip [N], columns x, y, z.

        Raises:
            ArgumentError: wrong shape, not finite, or a model whose sections have no bends.
        """
        rows, shape = self._rows.actuations(actuation)
        model = self._bending()
        pairs = self._rows.pairs(rows, load, shape)
        found = [arc_values(self.description, model.arcs(*each).tolist()) for each in pairs]
        columns = len(self.bend_columns)
        return (np.reshape(found, (-1, columns)) / self._per_edge()).reshape(*shape, columns)

    def ik_bends(
        self, bends: ArrayLike, *, load: ArrayLike | None = None, seed: ArrayLike | None = None
    ) -> AnswerRecords:
        """Actuations inside the limits that have bends of the sections; as `ik` otherwise.

        Args:
            bends: columns `bend_columns`.
            load: known force on the tip [N], columns x, y, z.
            seed: where a search begins, columns `axes`; None: the rest pose.

        Raises:
            ArgumentError: wrong shape, not finite, or a model whose sections have no bends.
        """
        self._bending()
        rows, shape = as_rows("bends", bends, self.bend_columns)
        reader = RowReader(",".join(arc_names(self.description)), "bends", {self.name: self.description})
        targets = [
            reader.layout.targets(reader.row(row, number))[self.name]
            for number, row in enumerate((rows * self._per_edge()).tolist(), 1)
        ]
        loads, seeds = self._rows.loads(load, shape), self._rows.seeds(seed, shape)
        return self._answers(inverse_each(self._model, targets, seeds, loads), shape)

    def _bending(self) -> Bending:
        if "arcs" not in self.description.accepts or not isinstance(self._model, Bending):
            kind = self.description.model
            raise ArgumentError(f"bends: sections of model {kind} of {self.name} have no bends of their own")
        return self._model

    def _per_edge(self) -> Array:
        """Units of files per unit of the library, of `bend_columns`."""
        quantities = [Quantity.LENGTH if "length" in name else Quantity.ANGLE for name in self.bend_columns]
        return np.array([each.per_si if self.units.si else 1.0 for each in quantities])

    def jacobian(self, actuation: ArrayLike, *, load: ArrayLike | None = None) -> Array:
        """Derivative of the tip by the actuation, shape ``(..., 3, axes)`` (2 for planar robots).

        In mm per mm or mm per bar (SI: m/m, m/Pa). Analytic; a rod stays in equilibrium.
        """
        rows, shape = self._rows.actuations(actuation)
        found = [self._model.jacobian(*pair) for pair in self._rows.pairs(rows, load, shape)]
        base = np.reshape(found, (len(rows), 3, rows.shape[1]))
        scale = self.units.scale() / self.units.scale(self.description.quantity)
        world = self._placed.columns_in_world(base)[:, : self.dimension] * scale
        return world.reshape(*shape, self.dimension, rows.shape[1])

    def compliance(self, actuation: ArrayLike, *, load: ArrayLike | None = None) -> Array:
        """Derivative of the tip by a force on it at constant actuation, shape ``(..., 3, 3)``.

        In mm/N (SI: m/N), symmetric, of the equilibrium under ``load``; analytic.

        Raises:
            ArgumentError: wrong shape, not finite, or a model that does not bend under a load.
        """
        rows, shape = self._rows.actuations(actuation)
        model = self._model
        if not isinstance(model, Compliant):
            kind = self.description.model
            raise ArgumentError(f"compliance: model {kind} of {self.name} does not bend under a load")
        found = [model.compliance(*pair) for pair in self._rows.pairs(rows, load, shape)]
        world = self._placed.tensors_in_world(np.reshape(found, (len(rows), 3, 3)))
        return (world * self.units.scale()).reshape(*shape, 3, 3)

    def backbone(self, actuation: ArrayLike, points: int = 50, *, load: ArrayLike | None = None) -> Array:
        """Points of the backbone at equal arc length from base to tip, shape ``(..., points, 3)``."""
        if points < 2:
            raise ArgumentError(f"points={points}: a backbone needs at least 2")
        rows, shape = self._rows.actuations(actuation)
        pairs = self._rows.pairs(rows, load, shape)
        found = [self._model.shape(actuation, points, force) for actuation, force in pairs]
        lines = self._placed.points_in_world(np.reshape(found, (len(rows), points, 3)))
        return self.units.from_si(lines).reshape(*shape, points, self.dimension)

    # -- reach and figures -------------------------------------------------------------------------------

    def workspace(self, voxel: float | None = None, *, across: int = 24) -> Workspace:
        """The set of points that the tip reaches: an exact area, or a volume of voxels in space.

        Args:
            voxel: edge of a voxel; None for ``across`` voxels over the widest side.
            across: see ``voxel``.

        Raises:
            ArgumentError: a planar model without an exact region.
            MissingExtraError: shapely is not installed (planar robots).
        """
        return measure_workspace(self._model, self.description.base, self.units, voxel, across)

    def plot(
        self,
        actuation: ArrayLike | None = None,
        *,
        points: ArrayLike | None = None,
        values: ArrayLike | None = None,
        label: str = "",
        axes: Axes | None = None,
    ) -> Axes:
        """Draw backbones of actuations, or points, into a new figure or given axes of matplotlib.

        Args:
            actuation: columns `axes`; the rest pose when there are no points either.
            points: positions, such as targets.
            values: one per point, for its colour: ``answer.residual``.
            label: label of the bar of colours.
            axes: axes to draw into; of a projection in space for spatial robots.

        Raises:
            ArgumentError: wrong shape, or not finite.
            MissingExtraError: matplotlib is not installed.
        """
        if actuation is None and points is None:
            actuation = self.limits.rest
        drawing = required(WORKSPACES, "drawing", "Robot.plot", "reach")
        axes = drawing.new_axes(self.dimension, self.units.length) if axes is None else axes
        if points is not None:
            rows, shape = as_rows("points", points, self._rows.point_columns)
            colours = None if values is None else as_values("values", values, shape)
            drawing.draw_points(axes, rows, colours, label)
        if actuation is not None:
            lines = self.backbone(actuation)
            drawing.draw_backbones(axes, lines.reshape(-1, *lines.shape[-2:]))
        axes.set_aspect("equal")
        return axes
