"""A model with axes beyond its kinematics: wrist, gripper or any other axis with a stroke or an angle.

They follow the model's own axes in every actuation and take the value of their column, clamped to their
limits; a target that does not name one leaves it where it is, and one that names nothing else leaves the
model's own axes where they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.model import Bending, Compliant, Following, Model, build_model_for_ticks
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3


class WithExtraAxes:
    """The `Model` protocol over ``own axes + extra axes``."""

    def __init__(
        self, model: Model, names: tuple[str, ...], limits: Mapping[str, tuple[float, float]]
    ) -> None:
        self._model = model
        self._own = len(model.axis_names)
        self._extra = names
        ends = [limits.get(name, (-math.inf, math.inf)) for name in names]
        self.axis_names = (*model.axis_names, *names)
        self.lower: Actuation = (*model.lower, *(low for low, _ in ends))
        self.upper: Actuation = (*model.upper, *(high for _, high in ends))
        self.dimension = model.dimension
        self.taut = getattr(model, "taut", None)
        self.capstan = getattr(model, "capstan", None)
        self.shared = getattr(model, "shared", None)
        self.avoid = getattr(model, "avoid", None)
        self.arcs = self.of_arcs = None
        if isinstance(model, Bending):
            own, bends = self._own, model.arcs
            self.arcs = lambda actuation, load_n=ZERO3: bends(actuation[:own], load_n)
            self.of_arcs = model.of_arcs
        if isinstance(model, Following):
            self.follows, self.follow = model.follows, self._follow
        self.compliance = None
        if isinstance(model, Compliant):
            own, complies = self._own, model.compliance
            self.compliance = lambda actuation, load_n=ZERO3: complies(actuation[:own], load_n)
        self.straight_approach: bool = getattr(model, "straight_approach", False)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """The model's own forward kinematics; extra axes do not move the tip."""
        return self._model.forward(actuation[: self._own], load_n)

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """The model's answer, followed by the extra axes of the target, clamped into their strokes.

        One that is not a number holds the whole robot, as it does among the model's own axes.
        """
        if any(map(math.isnan, target.extra.values())):
            return Solution.not_finite(seed, "a requested axis")
        own, rest = seed[: self._own], seed[self._own :]
        if target.tip_m is None and target.actuation is None and target.arcs is None:
            solution = Solution(own, 0.0, converged=True)
        else:
            solution = self._model.inverse(target, own)
        return self._whole(target, solution, rest)

    def _follow(self, target: Target, answer: Actuation) -> Solution:
        """See `contid.kinematics.model.Following`."""
        assert isinstance(self._model, Following)
        if any(map(math.isnan, target.extra.values())):
            return self.inverse(target, answer)
        return self._whole(target, self._model.follow(target, answer[: self._own]), answer[self._own :])

    def _whole(self, target: Target, solution: Solution, rest: Actuation) -> Solution:
        """A solution of the model's own axes, followed by the extra axes; those at rest are given."""
        values: list[float] = []
        binding: list[str] = []
        for name, last, low, high in zip(
            self._extra, rest, self.lower[self._own :], self.upper[self._own :], strict=True
        ):
            requested = target.extra.get(name, last)
            values.append(min(max(requested, low), high))
            if name in target.extra and values[-1] != requested:
                binding.append(f"{name}.{'max' if requested > high else 'min'}")
        actuation = (*solution.actuation, *values)
        if not binding:
            return replace(solution, actuation=actuation)
        note = f"{solution.note}; " if solution.note else ""
        return replace(
            solution,
            actuation=actuation,
            converged=False,
            limited_by=(*solution.limited_by, *binding),
            note=f"{note}{', '.join(binding)} exceeded",
        )

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """The model's own backbone, shape ``(points, 3)`` [m]."""
        return self._model.shape(actuation[: self._own], points, load_n)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """The model's own Jacobian with zero columns for the extra axes, shape ``(3, axes)``."""
        own = self._model.jacobian(actuation[: self._own], load_n)
        return np.hstack([own, np.zeros((3, len(self._extra)))])


def build_whole_model(robot: RobotDescription) -> Model:
    """The model of a robot including its extra axes: what the control loop drives."""
    model = build_model_for_ticks(robot)
    names = robot.extra_axis_names
    return WithExtraAxes(model, names, robot.extra_limits) if names else model
