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
        self._bends = statics.bends_by_pulls
        self._demand = statics.demand
        self._floor_n = statics.floor_n
        self._rest_n = statics.rest_n
        self._n_per_m = np.array(statics.tendon_n_per_m)
        self._free = statics.slack_free
        self._pulls = statics.geometry.pull_matrix
        slices = statics.geometry.tendon_slices
        self._first = np.array([rows.start for rows in slices])
        self._section = np.repeat(np.arange(len(slices)), [rows.stop - rows.start for rows in slices])

    def tightness(self, pulls: Array) -> Array:
        """Tightness of every section ``(sections,)`` [N]."""
        tensions = self._rest_n + self._n_per_m * (pulls - self._pulls @ (self._bends @ pulls))
        tightness: Array = np.minimum.reduceat((tensions - self._floor_n) / self._free, self._first)
        return tightness

    def tightened(self, pulls: Array, tightness: Array) -> Array:
        """Pulls ``(tendons,)`` [m] of the same bends with at least this tightness ``(sections,)`` [N]."""
        lacks = np.maximum(tightness - self.tightness(pulls), 0.0)
        tightened: Array = pulls + lacks[self._section] * self._free / self._n_per_m
        return tightened

    def split(self, pulls: Array) -> Array:
        """Coordinates of pulls ``(tendons,)`` [m], in which tightness and bends are apart.

        Bends ``(2 sections,)`` [rad], tightness ``(sections,)`` [N], and what is left of the pulls [m], which
        neither bends nor tightens: nothing for three tendons per section.
        """
        bends, tightness = self._bends @ pulls, self.tightness(pulls)
        left = pulls - self._joined(bends, tightness)
        return np.concatenate((bends, tightness, left))

    def join(self, coordinates: Array) -> Array:
        """Pulls ``(tendons,)`` [m] of coordinates."""
        count = len(self._first)
        bends, tightness, left = np.split(coordinates, (2 * count, 3 * count))
        pulls: Array = self._joined(bends, tightness) + left
        return pulls

    def _joined(self, bends: Array, tightness: Array) -> Array:
        least = self._demand @ bends
        up = np.maximum.reduceat((self._floor_n - least) / self._free, self._first) + tightness
        tensions = least + up[self._section] * self._free
        pulls: Array = self._pulls @ bends + (tensions - self._rest_n) / self._n_per_m
        return pulls
