"""Regression of the tip errors that a model leaves: a bounded correction of its tips.

Ridge regression on bends, their products, and the stretches of the tendons. The correction is used where
there were data: features are clamped to their range in the training rows, the correction fades with the
distance from that range, and its length is bounded by the errors it was made from. Patterns (the motions of
which a recording consists) are kept out of the fit in turn; the penalty of the ridge regression is the one
with the least error on them. "No correction" is among the choices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Penalties of the ridge regression to choose from; the infinite one is no correction.
PENALTIES: Final = (1.0, 10.0, 100.0, 1e3, 1e4, np.inf)
#: Parts of the recording that are kept out in turn.
FOLDS: Final = 6
#: The correction is at most as long as this quantile of the lengths of the training errors.
BOUND_QUANTILE: Final = 0.9
#: Standard deviation of the Gaussian by which the correction fades outside the range of the training rows, as
#: a part of that range.
_FADE: Final = 0.25


@dataclass(frozen=True, eq=False)
class Residual:
    """A correction of tips over features.

    Attributes:
        low, high: range of the features in the training rows.
        centre, scale: mean and standard deviation of their polynomial terms.
        gain: ``(terms + 1, 3)`` [m]; the last row is the constant.
        bound_m: greatest length of a correction.
        bends: how many of the features are bends, which are multiplied with each other.
        penalty: penalty of the ridge regression, as chosen; infinite for no correction.
    """

    low: Array
    high: Array
    centre: Array
    scale: Array
    gain: Array
    bound_m: float
    bends: int
    penalty: float

    def correction(self, features: Array) -> Array:
        """To add to the tips, ``(rows, 3)`` [m]."""
        if not np.isfinite(self.penalty):
            return np.zeros((len(features), 3))
        inside = np.clip(features, self.low, self.high)
        span = np.maximum(self.high - self.low, 1e-12)
        outside = np.sqrt((((features - inside) / span) ** 2).sum(axis=1))
        fade = np.exp(-0.5 * (outside / _FADE) ** 2)
        terms = (_terms(inside, self.bends) - self.centre) / self.scale
        step = (terms @ self.gain[:-1] + self.gain[-1]) * fade[:, None]
        length = np.sqrt((step**2).sum(axis=1, keepdims=True))
        bounded: Array = step * np.minimum(1.0, self.bound_m / np.maximum(length, 1e-12))
        return bounded


def _terms(features: Array, bends: int) -> Array:
    first, second = np.triu_indices(bends)
    return np.hstack((features, features[:, first] * features[:, second]))


def _solve(features: Array, error: Array, bends: int, penalty: float) -> Residual:
    low, high = features.min(axis=0), features.max(axis=0)
    terms = _terms(features, bends)
    centre, scale = terms.mean(axis=0), np.maximum(terms.std(axis=0), 1e-12)
    bound = float(np.quantile(np.sqrt((error**2).sum(axis=1)), BOUND_QUANTILE))
    design = (terms - centre) / scale
    constant = error.mean(axis=0)
    if np.isfinite(penalty):
        square = design.T @ design + penalty * np.eye(design.shape[1])
        gain = np.linalg.solve(square, design.T @ (error - constant))
    else:
        gain = np.zeros((design.shape[1], 3))
    return Residual(low, high, centre, scale, np.vstack((gain, constant)), bound, bends, penalty)


def fit_residual(features: Array, missing_m: Array, runs: Array, bends: int) -> Residual:
    """Fit the correction.

    Args:
        features: ``(rows, any)``, bends [rad], then stretches of tendons (tension over stiffness) [m].
        missing_m: measured minus predicted tips, ``(rows, 3)``.
        runs: number of the pattern of each row; folds are blocks of consecutive patterns.
        bends: how many features are bends.

    Returns:
        The correction; one pattern alone gives none.
    """
    fold = np.minimum((runs - np.min(runs)) * FOLDS // (np.ptp(runs) + 1.0), FOLDS - 1)
    if len(np.unique(fold)) < 2:  # nothing can be kept out
        return _solve(features, missing_m, bends, np.inf)
    scores = []
    for penalty in PENALTIES:
        total = 0.0
        for number in np.unique(fold):
            held_out = fold == number
            fitted = _solve(features[~held_out], missing_m[~held_out], bends, penalty)
            left_m = missing_m[held_out] - fitted.correction(features[held_out])
            total += float((left_m**2).sum())
        scores.append(total)
    return _solve(features, missing_m, bends, PENALTIES[int(np.argmin(scores))])
