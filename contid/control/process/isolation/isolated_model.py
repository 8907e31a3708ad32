"""A model in a process of its own, as the robots of the tick and the daemon have it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from contid.kinematics.array import Array
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3

#: Methods of optional interfaces, which a model has only if the one in the process has it.
_OPTIONAL: Final = ("compliance", "arcs", "of_arcs", "forward_under")


class IsolatedModel:
    """See `contid.kinematics.model.Model`; a process answers."""

    def __init__(self, ask: Callable[..., Any], found: Mapping[str, Any], *, brief: bool) -> None:
        """Methods of the optional interfaces are attributes of this object alone: it is recognised by them.

        Args:
            ask: takes whether to search briefly, a method and its arguments; returns the answer.
            found: what the process found about its model.
            brief: searches are short.
        """
        self.axis_names: tuple[str, ...] = tuple(found["axis_names"])
        self.lower: Actuation = tuple(found["lower"])
        self.upper: Actuation = tuple(found["upper"])
        self.dimension: int = found["dimension"]
        self.straight_approach: bool = found["straight_approach"]
        self._ask = partial(ask, brief)
        for name in _OPTIONAL:
            if name in found["methods"]:
                setattr(self, name, partial(self._ask, name))
        if found["searches"] and not brief:
            self.for_ticks = lambda: IsolatedModel(ask, found, brief=True)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """See `Model.forward`."""
        pose: Pose = self._ask("forward", actuation, load_n)
        return pose

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """See `Model.inverse`."""
        solution: Solution = self._ask("inverse", target, seed)
        return solution

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """See `Model.shape`."""
        line: Array = self._ask("shape", actuation, points, load_n)
        return line

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """See `Model.jacobian`."""
        derivative: Array = self._ask("jacobian", actuation, load_n)
        return derivative
