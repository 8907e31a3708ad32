"""What every model does with targets that are too far away to compute with, or not finite.

The nearest answer to a target far beyond the robot depends on its direction only, but the differences
between postures are lost in the rounding of such a distance, and its square overflows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from itertools import chain
from typing import TYPE_CHECKING, Final, TypeVar

from contid.targets import REACH, Actuation, Solution, Target, Vec3

if TYPE_CHECKING:
    from contid.kinematics.model import Model

    M = TypeVar("M", bound=Model)

#: Largest coordinate of a target that models compute with [m].
FAR_M: Final = 1e4
_TOLERANCE: Final = "reach_tolerance_m"


def any_target(
    inverse: Callable[[M, Target, Actuation], Solution],
) -> Callable[[M, Target, Actuation], Solution]:
    """Decorator of `Model.inverse`: the method itself gets finite targets within `FAR_M` only.

    A target farther away gets the answer to the one at `FAR_M` in its direction; the error is that to the
    target itself. With a target that is not finite the last command is held. Bends of sections become the
    actuation that has them. A tip that is missed by no more than what `tolerate` allows counts as met.

    Raises:
        ValueError: from the answer, for bends where the model has no `contid.kinematics.model.Bending`.
    """

    @wraps(inverse)
    def answer(self: M, target: Target, seed: Actuation) -> Solution:
        tip, mid = target.tip_m, target.mid_m
        asked = (target.actuation, target.arcs, tip, target.direction, mid, target.rotation, target.load_n)
        if not all(map(math.isfinite, chain.from_iterable([each for each in asked if each is not None]))):
            return Solution.not_finite(seed, "the target" if target.actuation is None else "a requested axis")
        if target.arcs is not None:
            of_arcs = getattr(self, "of_arcs", None)
            if of_arcs is None:
                raise ValueError("this robot takes no bends of its sections")
            actuation = of_arcs(target.arcs, seed, target.load_n)
            if not all(map(math.isfinite, actuation)):
                return Solution(seed, math.inf, False, (REACH,), note="no actuation has these bends")
            target = replace(target, arcs=None, actuation=actuation)
        if tip is None:
            return inverse(self, target, seed)
        if max(map(abs, tip if mid is None else (*tip, *mid))) <= FAR_M:
            found = inverse(self, target, seed)
            if found.converged or not found.residual_m <= tolerance_of(self):  # NaN included
                return found
            return replace(found, converged=True)
        mid_near = None if mid is None else _brought_near(mid)
        found = inverse(self, replace(target, tip_m=_brought_near(tip), mid_m=mid_near), seed)
        pose = self.forward(found.actuation, target.load_n)
        left_m = math.hypot(math.dist(pose.tip_m, tip), 0.0 if mid is None else math.dist(pose.mid_m, mid))
        note = f"the target is farther away than {FAR_M:g} m; this is the nearest answer in its direction"
        return replace(found, residual_m=left_m, converged=False, note=note)

    return answer


def tolerate(model: object, tolerance_m: float) -> None:
    """Let a model count tips as met that it misses by no more than this [m]."""
    setattr(model, _TOLERANCE, tolerance_m)


def tolerance_of(model: object) -> float:
    """What `tolerate` allows [m], -1 for nothing."""
    tolerance_m: float = getattr(model, _TOLERANCE, -1.0)
    return tolerance_m


def _brought_near(point_m: Vec3) -> Vec3:
    x, y, z = point_m
    most = max(map(abs, point_m))
    return point_m if most <= FAR_M else (x / most * FAR_M, y / most * FAR_M, z / most * FAR_M)
