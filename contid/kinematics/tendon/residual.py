"""What the model of a tendon robot leaves of its measured tips, as a bounded function of bends and stretches.

Features are the bends [rad] and the stretches of the tendons beyond their pretension [mm]; terms are the
features and the products of the bends. Features are clamped to the range of the data the correction was
fitted to; it fades with the distance from that range, in shares of it,

    c = bounded(gain . terms(clamped) exp(-8 outside^2)),

and no correction is longer than its bound. `contid calibrate tendon` writes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array, size_of
from contid.kinematics.tendon.tension import TendonStatics
from contid.robot_file.tendon.statics import TendonResidual
from contid.units import MM_PER_M

#: Exponent of the fading: 1 / (2 * 0.25^2), as in the fit.
_FADING = 8.0


@dataclass(frozen=True, eq=False)
class TipCorrection:
    """The correction of one robot.

    Attributes:
        features: matrix from pulls to features, ``(features, tendons)`` [rad/m, then mm/m].
        bends: how many of them are bends.
        low, high: their range in the data.
        gain: ``(terms + 1, 3)`` [m]; the last row is the constant.
        bound_m: greatest length.
    """

    features: Array
    bends: int
    low: Array
    high: Array
    gain: Array
    bound_m: float

    @classmethod
    def of(cls, described: TendonResidual, statics: TendonStatics) -> TipCorrection:
        """From a robot file."""
        by_pulls = statics.bends_by_pulls
        stretch = np.eye(len(statics.rest_n)) - statics.geometry.pull_matrix @ by_pulls
        gain = np.stack((described.gain_x_mm, described.gain_y_mm, described.gain_z_mm), axis=1) / MM_PER_M
        return cls(
            np.vstack((by_pulls, MM_PER_M * stretch)),
            len(by_pulls),
            np.array(described.low_rad_mm),
            np.array(described.high_rad_mm),
            gain,
            described.bound_mm / MM_PER_M,
        )

    def at(self, pulls: Array) -> Array:
        """To add to the tip ``(3,)`` [m]."""
        return self._both(pulls)[0]

    def slope(self, pulls: Array) -> Array:
        """Its derivative by the pulls ``(3, tendons)``."""
        return self._both(pulls)[1]

    def _both(self, pulls: Array) -> tuple[Array, Array]:
        given = self.features @ pulls
        inside = np.clip(given, self.low, self.high)
        free = (given == inside).astype(float)
        first, second = np.triu_indices(self.bends)
        terms = np.concatenate((inside, inside[first] * inside[second], [1.0]))
        step = terms @ self.gain
        by = self.gain[: len(given)].T.copy()  # by the features
        for row, (a, b) in enumerate(zip(first, second, strict=True), start=len(given)):
            by[:, a] += self.gain[row] * inside[b]
            by[:, b] += self.gain[row] * inside[a]
        by *= free
        span = np.maximum(self.high - self.low, 1e-12)
        outside = (given - inside) / span
        fade = float(np.exp(-_FADING * float(outside @ outside)))
        by = fade * (by - 2.0 * _FADING * np.outer(step, outside / span))
        step = fade * step
        length = size_of(step)
        if length > self.bound_m:
            along = step / length
            by = self.bound_m / length * (by - np.outer(along, along @ by))
            step = self.bound_m * along
        return step, by @ self.features
