"""Pulls as bends and tightness: the coordinates in which no motion makes a tendon slack.

The tightness of a section is how far its tensions stand above the least ones that hold its bends, as a
multiple of the tensions that do not bend (`contid.kinematics.tendon.tension`); below 0 a tendon is under the
floor. Bends and tightness together are as many numbers as there are pulls for three tendons per
section. The limits of tension and travel are convex in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.tendon.feasible import TendonFeasible
from contid.kinematics.tendon.tension import TendonStatics
from contid.targets import Actuation


@dataclass(frozen=True)
class PullLimits:
    """The limits of pulls, without the model: a model that holds them is in no cycle of references."""

    lower: Actuation
    upper: Actuation
    statics: TendonStatics | None
    feasible: TendonFeasible
    #: Variables of the solver [m] by pulls [m].
    by_pulls: Array

    def excess(self, actuation: Actuation) -> Array:
        """By how much limits of travel, tension and bends are exceeded by pulls [m], negative inside.

        In the order: least pull, largest pull, slack, tension per tendon; bend per section.
        """
        q = np.array(actuation)
        x = self.by_pulls @ q
        lower, upper, bend_max_m = self._bounds
        parts = [lower - q, q - upper]
        if self.statics is not None:
            k = self.statics.tendon_n_per_m
            tension = self.statics.tensions(q)
            parts += [(self.statics.floor_n - tension) / k, (tension - self.statics.limit_n) / k]
        parts.append(np.hypot(x[0::2], x[1::2]) - bend_max_m)
        return np.concatenate(parts)

    @cached_property
    def _bounds(self) -> tuple[Array, Array, Array]:
        """Least and largest pulls [m], and the largest bend of every section times its length [m]."""
        bend_max_m = np.array(self.feasible.sections.backbone_m) * np.array(self.feasible.bend_max_rad)
        return np.array(self.lower), np.array(self.upper), bend_max_m


class TautPulls:
    """The bounds of the tensions of a tendon robot for the limiter of its commands.

    Attributes:
        lower, upper: limits of travel [m].
        range_n: largest tension minus the floor [N].
        stiffness_n_per_m: least stiffness of a tendon [N/m].
        kernel: conversions between pulls, and bends with tightness, and the limiter (``limiter/taut.hpp``).
    """

    def __init__(self, limits: PullLimits, statics: TendonStatics) -> None:
        geometry = statics.geometry
        sections = limits.feasible.sections
        self._statics = statics
        self.lower, self.upper = limits.lower, limits.upper
        self.range_n = statics.limit_n - statics.floor_n
        self.stiffness_n_per_m = float(statics.tendon_n_per_m.min())
        self.kernel: Any = load("limiter").TautPulls(
            demand=statics.demand,
            pull_matrix=geometry.pull_matrix,
            bends_by_pulls=statics.bends_by_pulls,
            variables_by_pulls=limits.by_pulls,
            slack_free=statics.slack_free,
            rest=statics.rest_n,
            stiffness=statics.tendon_n_per_m,
            section_of=geometry.section_of,
            bend_max=np.array(sections.backbone_m) * np.array(limits.feasible.bend_max_rad),
            floor=statics.floor_n,
            limit=statics.limit_n,
        )

    def excess(self, pulls: Actuation) -> float:
        """By how much the limit that is exceeded most is exceeded [m], negative inside; convex."""
        return float(self.kernel.greatest_excess(pulls, self.lower, self.upper))

    def lifted(self, pulls: Actuation, width_n: float) -> Actuation:
        """Pulls [m] of the same bends with every tension at least ``width_n`` [N] above the floor.

        Their tightness is smooth in the bends, see ``limiter/taut_pulls.hpp``; where limits leave less room
        it is less.
        """
        lifted: Actuation = self.kernel.lifted(pulls, self.upper, width_n)
        return lifted

    def tightness(self, pulls: Array) -> Array:
        """Tightness of every section ``(sections,)`` [N] of pulls ``(tendons,)`` [m]."""
        statics = self._statics
        above = (statics.tensions(pulls) - statics.floor_n) / statics.slack_free
        tightness: Array = np.minimum.reduceat(above, statics.geometry.first_of)
        return tightness
