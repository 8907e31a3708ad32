"""Fit of a model to a recording: least squares with expectations, and intervals that allow for patterns.

Minimises ``sum |tip error|^2 / noise^2 + sum ((parameter - expected) / spread)^2``. Errors within one pattern
are alike, so rows are no independent measurements: the covariance is the sandwich over patterns,

    H^-1 (sum_g s_g s_g^T  G / (G - 1) + spread^-2) H^-1,     H = J^T J / noise^2 + spread^-2,
    s_g: gradient of pattern g of G

(Liang, Zeger: Longitudinal data analysis using generalized linear models, Biometrika 1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.models import Prediction, RecordingModel
from contid_fit.calibrate.tendon.recording import TendonRecording

#: Scale of tip errors against expectations [m]: what friction leaves, far above the noise of the tracker.
NOISE_M: Final = 4e-3
CONFIDENCE: Final = 0.95
#: Evaluations of a model after which a fit is given up.
_EVALUATIONS: Final = 100
#: A fit has converged when a step changes the sum of squares by less than this share.
_TOLERANCE: Final = 1e-4


@dataclass(frozen=True, eq=False)
class TendonFit:
    """A fitted model.

    Attributes:
        model: what was fitted.
        vector: its parameters, in the units of `Parameters`, shape ``(parameters,)``.
        half_width: half widths of their 95 % intervals, the same shape.
        evaluations: number of evaluations of the model.
        converged: False when the fit was given up; the vector is then the best one found.
    """

    model: RecordingModel
    vector: Array
    half_width: Array
    evaluations: int
    converged: bool

    def rows(self, pull_m: Array) -> Prediction:
        """Tips of pulls ``(rows, tendons)`` in the order of time."""
        return self.model.rows(self.vector, pull_m)


class _Cached:
    """Residuals and their Jacobian of one model and recording; one evaluation gives both.

    Functions of ``z = (vector - expected) / spread``, shape ``(parameters,)``.

    Attributes:
        error: tip errors of the rows in use at the newest z [NOISE_M], ``(rows, 3)``.
        by: their derivatives by z, ``(rows, 3, parameters)``.
        evaluations: number of evaluations of the model.
    """

    def __init__(self, model: RecordingModel, recording: TendonRecording, use: Array) -> None:
        self.model, self.recording, self.use = model, recording, use
        self.expected, self.spread = model.parameters.expected, model.parameters.spread
        self.at: Array | None = None
        self.evaluations = 0

    def _evaluate(self, z: Array) -> None:
        if self.at is None or not np.array_equal(self.at, z):
            found = self.model.rows(self.expected + self.spread * z, self.recording.pull_m)
            self.error = (found.tip_m - self.recording.tip_m)[self.use] / NOISE_M
            self.by = found.by[self.use] * (self.spread / NOISE_M)
            self.at = z.copy()
            self.evaluations += 1

    def residuals(self, z: Array) -> Array:
        self._evaluate(z)
        return np.concatenate((self.error.ravel(), z))

    def jacobian(self, z: Array) -> Array:
        self._evaluate(z)
        return np.vstack((self.by.reshape(-1, len(z)), np.eye(len(z))))


def fit_model(
    model: RecordingModel,
    recording: TendonRecording,
    use: Array | None = None,
    start: Array | None = None,
) -> TendonFit:
    """Fit all parameters of a model.

    Args:
        model: what to fit.
        recording: all rows drive the model, because the robot remembers them.
        use: which rows have tips that count, shape ``(rows,)``; None: all.
        start: first vector; None: the expected one.
    """
    from scipy.optimize import least_squares
    from scipy.special import stdtrit

    use = np.ones(len(recording), dtype=np.bool_) if use is None else use
    cached = _Cached(model, recording, use)
    first = np.zeros(len(cached.spread)) if start is None else (start - cached.expected) / cached.spread
    found = least_squares(
        cached.residuals,
        first,
        jac=cached.jacobian,
        method="lm",
        ftol=_TOLERANCE,
        max_nfev=_EVALUATIONS,
    )
    z = np.asarray(found.x)
    covariance, patterns = _sandwich(cached, z, recording.runs[use])
    width = float(stdtrit(max(patterns - 1, 1), 0.5 + 0.5 * CONFIDENCE)) * np.sqrt(np.diag(covariance))
    vector = cached.expected + cached.spread * z
    return TendonFit(model, vector, width * cached.spread, cached.evaluations, found.status > 0)


def _sandwich(cached: _Cached, z: Array, runs: Array) -> tuple[Array, int]:
    """Covariance of z, and the number of patterns; ``runs`` has the number of the pattern of each row."""
    cached.residuals(z)
    size = len(z)
    flat = cached.by.reshape(-1, size)
    bread = np.linalg.inv(flat.T @ flat + np.eye(size))
    by_row = np.einsum("rap,ra->rp", cached.by, cached.error)
    _, place = np.unique(runs, return_inverse=True)
    patterns = int(np.max(place)) + 1
    scores = np.zeros((patterns, size))
    np.add.at(scores, place, by_row)
    meat = scores.T @ scores * (patterns / max(patterns - 1, 1)) + np.eye(size)
    return bread @ meat @ bread, patterns
