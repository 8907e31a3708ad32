"""Errors of predicted tips, with intervals over patterns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

CONFIDENCE: Final = 0.95
#: Samples of the bootstrap.
_SAMPLES: Final = 1000
_SEED: Final = 20


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of the predicted tips of one set of rows.

    Attributes:
        rmse_m: root mean square after removing the mean error vector.
        mean_m: mean of the errors' norms, nothing removed.
        rmse_95_m, mean_95_m: their 95 % intervals, by a bootstrap that draws patterns with replacement.
        rows: number of rows.
    """

    rmse_m: float
    mean_m: float
    rmse_95_m: tuple[float, float]
    mean_95_m: tuple[float, float]
    rows: int


def _rmse_and_mean(error: Array) -> tuple[float, float]:
    centred = error - error.mean(axis=0)
    rmse = float(np.sqrt((centred**2).sum(axis=1).mean()))
    return rmse, float(np.sqrt((error**2).sum(axis=1)).mean())


def accuracy(error_m: Array, runs: Array) -> Accuracy:
    """Accuracy of errors ``(rows, 3)`` [m]; ``runs`` has the number of the pattern of each row."""
    rmse, mean = _rmse_and_mean(error_m)
    groups = [np.flatnonzero(runs == each) for each in np.unique(runs)]
    random = np.random.default_rng(_SEED)
    drawn = np.array(
        [
            _rmse_and_mean(
                error_m[np.concatenate([groups[i] for i in random.integers(len(groups), size=len(groups))])]
            )
            for _ in range(_SAMPLES)
        ]
    )
    low, high = np.quantile(drawn, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE], axis=0)
    return Accuracy(
        rmse,
        mean,
        (float(low[0]), float(high[0])),
        (float(low[1]), float(high[1])),
        len(error_m),
    )
