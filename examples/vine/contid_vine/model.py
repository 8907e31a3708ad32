"""The vine: an arc of length S and turning angle theta = d/r, for a feed S and a pull d of a tendon at r.

x = S cosc(theta),  y = S sinc(theta); the inverse is closed: theta = 2 atan2(x, y), S = |p| / sinc(theta/2).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.rack.planar_arc import cosc, cosc_derivative, sinc, sinc_derivative
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3
from contid.units import MM_PER_M
from contid_vine.description import Vine

#: Residual of a converged solution [m].
_TOLERANCE_M: Final = 1e-9


class VineModel:
    """Forward and inverse kinematics of a vine; see the module for the equations."""

    dimension = 2

    def __init__(self, robot: Vine) -> None:
        self.axis_names = robot.axis_names
        self.lower, self.upper = robot.lower, robot.upper
        self._tendon_m = robot.geometry.tendon_mm / MM_PER_M

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Tip for feed and pull [m]; a load does not bend it in this model."""
        feed, theta = actuation[0], actuation[1] / self._tendon_m
        sin, cos = math.sin(theta), math.cos(theta)
        tip = (feed * cosc(theta), feed * sinc(theta), 0.0)
        return Pose(tip, (cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0), (sin, cos, 0.0), tip)

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Feed and pull for a tip, closed form; clamped to the limits where it is out of reach."""
        if target.actuation is not None:
            ideal = target.actuation
        else:
            assert target.tip_m is not None
            x, y, _ = target.tip_m
            theta = 2.0 * math.atan2(x, y)
            ideal = (math.hypot(x, y) / sinc(theta / 2.0), theta * self._tendon_m)
        within = zip(ideal, self.lower, self.upper, strict=True)
        actuation = tuple(min(high, max(low, value)) for value, low, high in within)
        binding = tuple(
            f"{name}.{'min' if value < got else 'max'}"
            for name, value, got in zip(self.axis_names, ideal, actuation, strict=True)
            if value != got
        )
        if target.tip_m is None:
            return Solution(actuation, max(map(abs, np.subtract(ideal, actuation))), not binding, binding)
        residual_m = math.dist(self.forward(actuation).tip_m, (*target.tip_m[:2], 0.0))
        return Solution(actuation, residual_m, residual_m < _TOLERANCE_M, binding)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> NDArray[np.float64]:
        """Tip by feed and pull, shape (3, 2)."""
        feed, theta = actuation[0], actuation[1] / self._tendon_m
        by_theta = feed / self._tendon_m
        return np.array(
            [
                [cosc(theta), by_theta * cosc_derivative(theta)],
                [sinc(theta), by_theta * sinc_derivative(theta)],
                [0.0, 0.0],
            ]
        )

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> NDArray[np.float64]:
        """Backbone at equal arc length, shape (points, 3) [m]."""
        feed, pull = actuation
        return np.array([self.forward((feed * s, pull * s)).tip_m for s in np.linspace(0.0, 1.0, points)])
