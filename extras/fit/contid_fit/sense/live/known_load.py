"""The load that an arm carries when no contact acts: a Kalman filter of a force that hardly changes.

The estimate of `contid_fit.sense.live.load_observer` follows a contact at once and is uncertain where the arm
is stiff. This filter begins with that estimate, then follows measurements that were no contact. While the arm
moves, its stiff direction changes, so the measurements determine one component of the force after the other;
the covariance states which are still uncertain.

Units: mm and N.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Standard deviation of the change of a component of the force in a second [N].
DRIFT_N: Final = 3e-4
#: Error of the model, which is the same in several measurements; added to the noise of each of them
#: (standard deviation) [mm].
MODEL_MM: Final = 2.0


class KnownLoad:
    """The load of one arm.

    Attributes:
        force: force in the base frame [N].
        covariance: covariance of the force, shape ``(3, 3)`` [N^2].

    Args:
        force: force to begin with [N].
        covariance: covariance of the force [N^2].
    """

    def __init__(self, force: Array, covariance: Array) -> None:
        self.force = force
        self.covariance = covariance

    def follow(self, residual_mm: Array, by_force: Array, noise: Array, since_s: float) -> Array:
        """Take a measurement that was no contact; returns the change of the estimated force [N].

        Args:
            residual_mm: measured tip minus that of the model under `force`, shape ``(3,)``.
            by_force: derivative of the tip by the force [mm/N], shape ``(3, 3)``.
            noise: covariance of the measurement [mm^2].
            since_s: time since the measurement before [s].
        """
        covariance = self.covariance + since_s * DRIFT_N**2 * np.eye(3)
        spread = by_force @ covariance @ by_force.T + noise + MODEL_MM**2 * np.eye(3)
        gain = np.linalg.solve(spread, by_force @ covariance).T
        step: Array = gain @ residual_mm
        self.force = self.force + step
        kept = covariance - gain @ by_force @ covariance
        self.covariance = 0.5 * (kept + kept.T)
        return step
