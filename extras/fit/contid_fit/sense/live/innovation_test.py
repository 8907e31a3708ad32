"""When measured tips leave what the model of a moving arm explains: a generalised likelihood ratio test.

Let r be the measured tip minus that of the model. Without a contact r is a slow pattern (the error that the
model has at this pose), a delay of the pressures beside the tracker, and noise::

    r_k = pattern + lag v_k + n_k,      n_k ~ N(0, noise^2 I + sigma_p^2 J J^T)

v is the velocity of the tip, J its derivative by the pressures. The pattern is the mean of older residuals;
lag and sigma_p (noise of the reported pressures) are learned while nothing is found. After a contact the
residual grows from its onset on, as a step or, where the arm runs into a wall, as a ramp. For every onset
within the newest residuals and both shapes the best amplitude d gives::

    S = sum(a_i (r_i - pattern)),    T = S^T (sum(a_i^2) N + sum(a_i)^2 B)^-1 S

with a_i the step or ramp at residual i, and N the covariance of the noise of one residual. T of noise alone
has a chi-squared distribution with three degrees of freedom. B is the covariance of the error that all
newest residuals share: of the pattern, of the lag, of the hysteresis and of the load while the arm moves.

Units: mm, s, bar, N. A pure function of its inputs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Number of newest residuals that may already be those of a contact, and of older ones that form the pattern.
NEWEST: Final = 6
REFERENCE: Final = 30
#: A larger T is a contact: noise alone exceeds it once in 2e6 tests.
GATE: Final = 32.0
#: Measurements of an hour at 50 Hz. The covariances are wide enough for the several shapes of each.
TESTS_PER_HOUR: Final = 180e3
#: Standard deviation of the lag before anything is learned, and its minimum [s].
_LAG_SIGMA_S: Final = 5e-3
_MIN_LAG_SIGMA_S: Final = 5e-4
#: Largest lag that is learned, with either sign [s].
_MAX_LAG_S: Final = 0.04
#: The lag is learned where the velocity of the tip differs by more than this from its mean over the pattern
#: [mm/s].
_MOVES_MM_S: Final = 20.0
#: Standard deviation of reported pressures before anything is learned, and its maximum [bar].
_PRESSURE_BAR: Final = 2e-3
_MAX_PRESSURE_BAR: Final = 0.05
#: Lag and noise are learned as averages over about this many residuals.
_MEMORY: Final = 500.0
#: Residuals at a larger squared distance are scaled down to it before lag and noise are learned from them.
_CLIPPED: Final = 16.0
#: Standard deviation of changes of the pattern of a moving arm that the terms above do not explain [mm].
_PATTERN_MM: Final = 0.05


def _shapes() -> Array:
    steps = [[1.0] * n + [0.0] * (NEWEST - n) for n in (1, 2, 3, 4)]
    ramps = [[max(0.0, float(n - i)) for i in range(NEWEST)] for n in range(2, NEWEST + 1)]
    return np.array(steps + ramps)


_SHAPES: Final = _shapes()
_SQUARES: Final = (_SHAPES**2).sum(axis=1)[:, None, None]
_SUMS: Final = (_SHAPES.sum(axis=1) ** 2)[:, None, None]


@dataclass(frozen=True, eq=False, slots=True)
class TipResidual:
    """One measurement beside the model.

    Attributes:
        residual_mm: measured tip minus that of the model, shape ``(3,)``.
        velocity: velocity of the tip since two measurements before [mm/s], shape ``(3,)``.
        by_pressure: derivative of the tip by the pressures [mm/bar], shape ``(3, k)``.
        shared: covariance of the error that this pose adds to all newest residuals, ``(3, 3)`` [mm^2].
        by_force: derivative of the tip by the force on it [mm/N], shape ``(3, 3)``.
        load_covariance: covariance of the known load, shape ``(3, 3)`` [N^2].
        swing_mm: amplitude by which the body may swing, `contid_fit.sense.live.swing`.
    """

    residual_mm: Array
    velocity: Array
    by_pressure: Array
    shared: Array
    by_force: Array
    load_covariance: Array
    swing_mm: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Departure:
    """Residuals that left the pattern.

    Attributes:
        shift_mm: shift of the newest residual, by the best shape, shape ``(3,)``.
        covariance: covariance of the shift, shape ``(3, 3)`` [mm^2].
        squared_distance: T above.
    """

    shift_mm: Array
    covariance: Array
    squared_distance: float

    @property
    def confidence(self) -> float:
        """1 minus the expected number of such departures by noise alone in an hour at 50 Hz; at least 0."""
        x = self.squared_distance
        tail = math.erfc(math.sqrt(0.5 * x)) + math.sqrt(2.0 * x / math.pi) * math.exp(-0.5 * x)
        return max(0.0, 1.0 - TESTS_PER_HOUR * tail)


class InnovationTest:
    """The residuals of one arm.

    Args:
        noise_mm: standard deviation of a measured tip, per component.

    Attributes:
        distance: T of the newest residuals.
        lag_s: time by which the measured tip is ahead of the reported pressures [s].
    """

    def __init__(self, noise_mm: float) -> None:
        self.distance = 0.0
        self._noise: Array = noise_mm**2 * np.eye(3)
        self._residual_mm: Array = np.zeros((0, 3))
        self._velocity: Array = np.zeros((0, 3))
        self._by_force: Array = np.zeros((0, 3, 3))
        self.lag_s = 0.0
        self._swing_mm = 0.0
        self._lag_information = 1.0 / _LAG_SIGMA_S**2
        self._pressure_bar2 = _PRESSURE_BAR**2
        #: Derivatives by the pressures of the newest residuals, the newest first.
        self._by_pressure: list[Array] = []

    @property
    def armed(self) -> bool:
        """True when a contact would be found."""
        return len(self._residual_mm) >= NEWEST + REFERENCE

    def clear(self) -> None:
        """Forget the pattern, but not lag and noise."""
        self._residual_mm, self._velocity, self._by_pressure = np.zeros((0, 3)), np.zeros((0, 3)), []
        self._by_force = np.zeros((0, 3, 3))

    def noise(self, residual: TipResidual) -> Array:
        """Covariance of one residual by all but the load, shape ``(3, 3)`` [mm^2]."""
        by_pressure, velocity = residual.by_pressure, residual.velocity
        noise: Array = self._noise + self._pressure_bar2 * by_pressure @ by_pressure.T + residual.shared
        noise = noise + residual.swing_mm**2 * np.eye(3)
        late: Array = max(1.0 / self._lag_information, _MIN_LAG_SIGMA_S**2) * np.outer(velocity, velocity)
        return noise + late

    def reload(self, step_n: Array) -> None:
        """Convert the residuals to those under a known load that changed by ``step_n`` [N]."""
        self._residual_mm = self._residual_mm - self._by_force @ step_n

    @property
    def confirms(self) -> bool:
        """True when there is a `confirmed` residual."""
        return len(self._residual_mm) >= NEWEST

    @property
    def confirmed(self) -> tuple[Array, Array, Array]:
        """Newest residual that is no contact [mm], its derivative by force [mm/N], its noise [mm^2].

        That is the oldest of the newest residuals: a contact would have been found by now.
        """
        row, by_pressure = NEWEST - 1, self._by_pressure[-1]
        residual_mm = self._residual_mm[row] - self.lag_s * self._velocity[row - 1]
        noise: Array = self._noise + self._pressure_bar2 * by_pressure @ by_pressure.T
        noise = noise + self._swing_mm**2 * np.eye(3)
        return residual_mm, self._by_force[row], noise

    def add(self, new: TipResidual) -> Departure | None:
        """Take a measurement; returns the departure when the residuals leave the pattern."""
        kept = NEWEST + REFERENCE - 1
        self._residual_mm = np.vstack([new.residual_mm, self._residual_mm[:kept]])
        self._velocity = np.vstack([new.velocity, self._velocity[:kept]])
        self._by_force = np.concatenate([new.by_force[None], self._by_force[:kept]])
        self._swing_mm = new.swing_mm
        self._by_pressure = [new.by_pressure, *self._by_pressure[: NEWEST - 1]]
        if not self.armed:
            return None
        # A velocity is the difference over two intervals, so that of the next measurement is centred on this
        # one, and free of the noise of its pressures.
        centred = np.vstack([self._velocity[0], self._velocity[:-1]])
        explained = self._residual_mm - self.lag_s * centred
        apart = explained[:NEWEST] - explained[NEWEST:].mean(axis=0)
        faster = centred[:NEWEST] - centred[NEWEST:].mean(axis=0)
        noise = self._noise + self._pressure_bar2 * new.by_pressure @ new.by_pressure.T
        lag_2 = max(1.0 / self._lag_information, _MIN_LAG_SIGMA_S**2)
        softer = new.by_force - self._by_force[NEWEST:].mean(axis=0)
        shared = noise / REFERENCE + new.shared + lag_2 * np.outer(faster[0], faster[0])
        shared = shared + softer @ new.load_covariance @ softer.T
        shared = shared + (new.swing_mm**2 + (_PATTERN_MM**2 if new.velocity.any() else 0.0)) * np.eye(3)
        sums = _SHAPES @ apart
        covariances = _SQUARES * noise + _SUMS * shared
        distances = (sums * np.linalg.solve(covariances, sums[:, :, None])[:, :, 0]).sum(axis=1)
        worst = int(distances.argmax())
        self.distance = float(distances[worst])
        if distances[worst] > GATE:
            # Amplitude by least squares; the newest residual has the largest weight of its shape.
            scale = float(_SHAPES[worst, 0] / _SQUARES[worst, 0, 0])
            return Departure(scale * sums[worst], scale**2 * covariances[worst], float(distances[worst]))
        if new.swing_mm == 0.0:
            self._learn(apart[-1], faster[-1], self._by_pressure[-1], shared)
        return None

    def _learn(self, apart: Array, faster: Array, by_pressure: Array, shared: Array) -> None:
        """Lag and noise from a residual that is no contact."""
        spread = by_pressure @ by_pressure.T
        noise = self._noise + self._pressure_bar2 * spread
        weight = np.linalg.inv(noise + shared)
        distance = float(apart @ weight @ apart)
        kept = min(1.0, math.sqrt(_CLIPPED / distance)) if distance > 0.0 else 1.0
        apart = kept * apart
        if float(faster @ faster) > _MOVES_MM_S**2:
            kept_information = self._lag_information * (1.0 - 1.0 / _MEMORY)
            self._lag_information = kept_information + float(faster @ weight @ faster)
            step = float(faster @ weight @ apart) / self._lag_information
            self.lag_s = min(max(self.lag_s + step, -_MAX_LAG_S), _MAX_LAG_S)
        seen_bar2 = float((apart @ apart - np.trace(self._noise)) / np.trace(spread))
        averaged = self._pressure_bar2 + (seen_bar2 - self._pressure_bar2) / _MEMORY
        self._pressure_bar2 = min(max(averaged, 0.0), _MAX_PRESSURE_BAR**2)
