"""What redundant axes minimise: the distance from home, and the potential of obstacles if there are any."""

from __future__ import annotations

import numpy as np

from contid.kinematics.arc.active_set import cholesky
from contid.kinematics.arc.avoid import Avoid
from contid.kinematics.arc.feasible import BoundedChain
from contid.kinematics.array import Array


class Objective:
    """A function of the lengths: ``1/2 (l - home)^T M (l - home)``, and the potential of `Avoid`.

    Args:
        feasible: limits, home and M.
        avoid: obstacles; None without.
    """

    def __init__(self, feasible: BoundedChain, avoid: Avoid | None = None) -> None:
        self._feasible = feasible
        self._avoid = avoid
        self._home_factor = cholesky(feasible.metric)

    def value(self, lengths: Array) -> float:
        """The function [m^2]."""
        feasible = self._feasible
        away = feasible.home - lengths
        value = 0.5 * float(away @ (feasible.metric @ away))
        return (
            value if self._avoid is None else value + self._avoid.potential(feasible.sections, lengths).value
        )

    def slope(self, lengths: Array) -> Array:
        """Minus its gradient, ``(N,)`` [m]."""
        feasible = self._feasible
        slope: Array = feasible.metric @ (feasible.home - lengths)
        if self._avoid is not None:
            slope = slope - self._avoid.potential(feasible.sections, lengths).gradient
        return slope

    def factor(self, lengths: Array) -> Array:
        """Lower Cholesky factor of the part of its second derivative that is positive definite."""
        if self._avoid is None:
            return self._home_factor
        found = self._avoid.potential(self._feasible.sections, lengths)
        if found.value == 0.0:
            return self._home_factor
        return cholesky(self._feasible.metric + found.stiffness)

    def push(self, lengths: Array) -> Array:
        """Gradient of the potential of obstacles, ``(N,)`` [m]."""
        if self._avoid is None:
            return np.zeros(len(lengths))
        return self._avoid.potential(self._feasible.sections, lengths).gradient
