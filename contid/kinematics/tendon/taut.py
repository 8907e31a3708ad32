"""Pulls as bends and tightness: the coordinates in which no motion makes a tendon slack.

The tightness of a section is how far its tensions stand above the least ones that hold its bends, as a
multiple of the tensions that do not bend (`contid.kinematics.tendon.tension`); below 0 a tendon is under the
floor. Bends and tightness together are as many numbers as there are pulls for three tendons per
section. The limits of tension and travel are convex in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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
    """Conversions between pulls [m] and bends [rad] with tightness [N]."""

    def __init__(self, statics: TendonStatics, limits: PullLimits) -> None:
        self.excess = limits.excess
        self._statics = statics
        self._count = statics.geometry.count

    def tightness(self, pulls: Array) -> Array:
        """Tightness of every section ``(sections,)`` [N]."""
        return self._tightness(pulls, self._statics.bends(pulls))

    def _tightness(self, pulls: Array, bends: Array) -> Array:
        """Tightness of pulls whose bends are known."""
        statics = self._statics
        above = (statics.tensions_at(pulls, bends) - statics.floor_n) / statics.slack_free
        tightness: Array = np.minimum.reduceat(above, statics.geometry.first_of)
        return tightness

    def tightened(self, pulls: Array, tightness: Array) -> Array:
        """Pulls ``(tendons,)`` [m] of the same bends with at least this tightness ``(sections,)`` [N]."""
        statics = self._statics
        lacks = np.maximum(tightness - self.tightness(pulls), 0.0)[statics.geometry.section_of]
        tightened: Array = pulls + lacks * statics.slack_free / statics.tendon_n_per_m
        return tightened

    def split(self, pulls: Array) -> Array:
        """Coordinates of pulls ``(tendons,)`` [m], in which tightness and bends are apart.

        Bends ``(2 sections,)`` [rad], tightness ``(sections,)`` [N], and what is left of the pulls [m], which
        neither bends nor tightens: nothing for three tendons per section.
        """
        bends = self._statics.bends(pulls)
        tightness = self._tightness(pulls, bends)
        return np.concatenate((bends, tightness, pulls - self._statics.pulls(bends, tightness)))

    def join(self, coordinates: Array) -> Array:
        """Pulls ``(tendons,)`` [m] of coordinates."""
        count = self._count
        bends, tightness = coordinates[: 2 * count], coordinates[2 * count : 3 * count]
        pulls: Array = self._statics.pulls(bends, tightness) + coordinates[3 * count :]
        return pulls
