"""The force on a tip from one measurement after the other: least squares on an average, with its uncertainty.

    minimise  (rbar - h(F + d) + h(F))^T (noise^2/n + M)^-1 (...) + |F + d|^2 / expected^2

h(F) is the tip of the model under the force F, rbar the average of ``measured tip - h(F)`` over the last n
measurements, M the covariance of the model. A step d is proposed by Levenberg-Marquardt and taken only when
the cost falls at the tip that the model really has there; rbar is then reduced by the motion of that tip. M
does not shrink with n: more measurements average out the noise of the tracker, not the error of the model.

A sudden change of the force is found by a test: the mean of the newest w differences is compared with its
covariance, for several w. The average then begins anew with these, so that the estimate follows at once.

Units: mm and N.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_fit.sense.live.symmetric import cofactors, squared_distance

#: A larger squared distance is a sudden change; noise alone exceeds it once in 1e9 tests of three components.
GATE: Final = 44.0
#: Numbers w of newest measurements whose mean is compared.
WIDTHS: Final = (1, 2, 3, 5, 8)
#: Measurements in the average before sudden changes are looked for.
_ARMED: Final = 15
#: Components of a step below this are rounding [N].
_ROUNDED_N: Final = 1e-6
#: Damping after the first step that did not lower the cost, relative to the diagonal.
_DAMPING: Final = 0.1


class LoadFilter:
    """The running estimate.

    Args:
        noise_mm: standard deviation of a measurement, per component.
        window_s: time constant of the average.
        expected_n: standard deviation of a component of the force before any measurement.

    Attributes:
        force: force in the base frame [N].
        covariance: covariance of the force, shape ``(3, 3)`` [N^2].
        count: measurements in the average.
    """

    def __init__(self, noise_mm: float, window_s: float, expected_n: float) -> None:
        self._noise_mm2 = noise_mm**2
        self._noise: Array = self._noise_mm2 * np.eye(3)
        self._window_s = window_s
        self._prior: Array = np.eye(3) / expected_n**2
        self.force: Array = np.zeros(3)
        self.covariance: Array = expected_n**2 * np.eye(3)
        self.count = 0
        self._residual: Array = np.zeros(3)
        self._newest: Array = np.zeros((0, 3))
        self._since_s = 0.0
        self._last_s = -math.inf
        self._weight: Array = self._prior
        self._compliance: Array = np.zeros((3, 3))
        self._information: Array = self._prior
        self._damping = 0.0
        self._tried: Array = self.force

    @property
    def settled(self) -> bool:
        """True when the average is as long as its time constant."""
        return self._since_s >= self._window_s

    def restart(self, force: Array) -> None:
        """Begin anew from a force."""
        self.force = force
        self._begin(np.zeros((0, 3)))

    def _begin(self, newest: Array) -> None:
        self.count, self._since_s = len(newest), 0.0
        self._residual = newest.mean(axis=0) if len(newest) else np.zeros(3)
        self._newest = newest

    def add(
        self, t_s: float, residual: Array, compliance: Array, model: Array
    ) -> Generator[None, None, bool]:
        """Take a measurement in two parts of work, with a yield between them.

        Returns True when the force changed suddenly.

        Args:
            t_s: when it was captured; later than the one before.
            residual: measured tip minus that of the model under `force` [mm].
            compliance: derivative of the tip by the force there [mm/N], shape ``(3, 3)``.
            model: covariance of the tip of the model [mm^2].
        """
        step_s = min(t_s - self._last_s, self._window_s)
        min_gain = -math.expm1(-step_s / self._window_s)
        self._last_s = t_s
        newest = np.concatenate([residual[None], self._newest[: WIDTHS[-1] - 1]])
        width = self._changed_since(newest, compliance, model) if self.count >= _ARMED else 0
        if width:
            self._begin(newest[:width])
        else:
            self.count += 1
            self._since_s += step_s if self.count > 1 else 0.0
            self._residual = self._residual + max(1.0 / self.count, min_gain) * (residual - self._residual)
            self._newest = newest
        yield
        # An exponential average of gain g has the variance of 2/g - 1 equal ones.
        average = self._noise / min(self.count, 2.0 / max(1.0 / self.count, min_gain) - 1.0)
        self._weight = _inverse(average + model)
        self._linearise(compliance)
        return width > 0

    def _linearise(self, compliance: Array) -> None:
        self._compliance = compliance
        self._information = compliance.T @ self._weight @ compliance + self._prior
        self.covariance = _inverse(self._information)

    def proposed(self) -> Array | None:
        """The force to be tried next [N]; None when the cost is at its minimum."""
        downhill = self._compliance.T @ self._weight @ self._residual - self._prior @ self.force
        if self._damping:
            damped = self._information + self._damping * np.diag(np.diag(self._information))
            step = _inverse(damped) @ downhill
        else:
            step = self.covariance @ downhill
        if max(map(abs, step.tolist())) < _ROUNDED_N:
            return None
        self._tried = self.force + step
        return self._tried

    def judge(self, moved: Array | None, compliance: Array) -> bool:
        """Take the proposed force when the cost falls there; True when it was taken.

        Args:
            moved: tip of the model there minus that under `force` [mm]; None where there is no equilibrium.
            compliance: derivative of the tip by the force there [mm/N].
        """
        if moved is not None and self._taken(self._tried, moved, compliance):
            self._damping *= 0.2
            return True
        self._damping = max(4.0 * self._damping, _DAMPING)
        return False

    def judge_unloaded(self, moved: Array, compliance: Array) -> bool:
        """Begin from no force when the cost is less there; True when it is.

        Args:
            moved: tip of the model without load minus that under `force` [mm].
            compliance: derivative of the tip by the force, without load [mm/N].
        """
        return self._taken(np.zeros(3), moved, compliance)

    def _taken(self, force: Array, moved: Array, compliance: Array) -> bool:
        residual = self._residual - moved
        if self._cost(force, residual) >= self._cost(self.force, self._residual):
            return False
        self.force, self._residual = force, residual
        self._newest = self._newest - moved
        self._linearise(compliance)
        return True

    def _cost(self, force: Array, residual: Array) -> float:
        return float(residual @ self._weight @ residual + force @ self._prior @ force)

    def _changed_since(self, newest: Array, compliance: Array, model: Array) -> int:
        """Number of newest measurements that show a sudden change best, 0 without one."""
        (a, b, c), (_, d, e), (_, _, f) = (model + compliance @ self.covariance @ compliance.T).tolist()
        largest, best_width = GATE, 0
        x = y = z = 0.0
        for width, (px, py, pz) in enumerate(newest.tolist(), 1):
            x, y, z = x + px, y + py, z + pz
            if width in WIDTHS:
                averaged, part = (x / width, y / width, z / width), self._noise_mm2 / width
                distance = squared_distance(averaged, (a + part, b, c, d + part, e, f + part))
                if distance > largest:
                    largest, best_width = distance, width
        return best_width


def _inverse(matrix: Array) -> Array:
    """Of a symmetric matrix, shape ``(3, 3)``."""
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    rows, whole = cofactors((a, b, c, d, e, f))
    a, b, c, d, e, f = [each / whole for each in rows]
    return np.array(((a, b, c), (b, d, e), (c, e, f)))
