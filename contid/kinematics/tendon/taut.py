"""Pulls as bends and tightness: the coordinates in which no motion makes a tendon slack.

The tightness of a section is how far its tensions stand above the least ones that hold its bends, as a
multiple of the tensions that do not bend (`contid.kinematics.tendon.tension`); below 0 a tendon is under the
floor. Bends and tightness together are as many numbers as there are pulls for three tendons per
section. The limits of tension and travel are convex in them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.tension import TendonStatics
from contid.targets import Actuation


class TautPulls:
    """Conversions between pulls [m] and bends [rad] with tightness [N].

    Args:
        statics: of the robot.
        excess: of the model: by how much pulls exceed every limit.
    """

    def __init__(self, statics: TendonStatics, excess: Callable[[Actuation], Array]) -> None:
        self.excess = excess
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
