"""Least squares with intervals that hold when errors are alike from sample to sample.

Output error: the parameters ``p`` make the sum of squares of ``r(p) = measured - predicted(p)`` least. What
a model leaves over is not white noise, so the covariance is that of the estimates without one block of time
each (the jackknife over blocks; Cameron and Miller 2015, CV3), to first order

    cov(p) = (B - 1) / B sum_b d_b d_b',   d_b = (J'J - J_b'J_b)^-1 J_b' r_b

with a quantile of Student's t. Its degrees of freedom are the effective number of blocks less the number of
parameters: blocks in which little moves add little. Errors may be correlated within a block, whose
length is to be longer than their memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

CONFIDENCE: Final = 0.95
#: Draws of a bootstrap.
_DRAWS: Final = 500
_SEED: Final = 50


@dataclass(frozen=True, slots=True)
class Interval:
    """A number and half of its 95 % interval; infinite where the data do not fix it."""

    value: float
    half: float

    @property
    def low(self) -> float:
        """Lower end."""
        return self.value - self.half

    @property
    def high(self) -> float:
        """Upper end."""
        return self.value + self.half

    def exponential(self) -> Interval:
        """Of the exponential of the number, to first order."""
        value = math.exp(self.value)
        return Interval(value, value * self.half)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters with their intervals.

    Attributes:
        values: shape ``(parameters,)``.
        covariance: shape ``(parameters, parameters)``, infinite on the diagonal where nothing is known.
        quantile: of Student's t, by which a standard deviation becomes half of a 95 % interval.
        residual: what is left, shape ``(samples, columns)``.
    """

    values: Array
    covariance: Array
    quantile: float
    residual: Array

    def interval(self, *weights: float) -> Interval:
        """A weighted sum of the parameters, weights in their order; those left out are 0."""
        row = np.zeros(len(self.values))
        row[: len(weights)] = weights
        used = row != 0.0
        part = self.covariance[np.ix_(used, used)]
        value = float(row @ self.values)
        if not np.isfinite(part).all():
            return Interval(value, float("inf"))
        return Interval(value, self.quantile * float(np.sqrt(max(row[used] @ part @ row[used], 0.0))))


def estimate(
    residual: Callable[[Array], Array], start: Array, low: Array, high: Array, blocks: Array
) -> Estimate:
    """Least squares from a start, within bounds.

    Args:
        residual: from parameters to what is left over, shape ``(samples, columns)``.
        start: shape ``(parameters,)``, as the next two.
        low: least values.
        high: greatest values.
        blocks: number of the block of time of each sample.
    """
    from scipy.optimize import least_squares
    from scipy.special import stdtrit

    margin = 1e-9 * np.maximum(np.abs(start), 1.0)
    start = np.clip(start, low + margin, high - margin)
    scale = np.maximum(np.abs(start), 1e-3)
    found = least_squares(
        lambda p: residual(p).ravel(), start, bounds=(low, high), x_scale=scale, xtol=1e-10, ftol=1e-12
    )
    left = residual(found.x)
    freedom = max(_effective_blocks(found.jac, left.shape[1], blocks) - len(start), 1.0)
    quantile = float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))
    return Estimate(found.x, _covariance(found.jac, left, blocks), quantile, left)


def half_intervals(jacobian: Array, residual: Array, blocks: Array, weight: Array, spread: Array) -> Array:
    """Half of the 95 % interval of each parameter of a fit towards a prior, by its blocks.

    Args:
        jacobian: of the prediction, ``(samples * columns, parameters)``.
        residual: what is left, ``(samples, columns)``.
        blocks: number of the block of time of each sample.
        weight: of the squared deviations from the prior, ``(parameters,)``.
        spread: how far from the prior parameters are expected, ``(parameters,)``.

    Returns:
        Shape ``(parameters,)``; a prior that is wrong by its spread is part of it.
    """
    from scipy.special import stdtrit

    names = np.unique(blocks)
    if len(names) < 2:
        return np.full(jacobian.shape[1], np.inf)
    normal = jacobian.T @ jacobian + np.diag(weight)
    of_row, left = np.repeat(blocks, residual.shape[1]), residual.ravel()
    variance = np.zeros(len(weight))
    for name in names:
        own = jacobian[of_row == name]
        variance += np.linalg.solve(normal - own.T @ own, own.T @ left[of_row == name]) ** 2
    variance *= (len(names) - 1.0) / len(names)
    variance += ((np.linalg.inv(normal) * (weight * spread)) ** 2).sum(axis=1)
    quantile = float(stdtrit(len(names) - 1.0, 0.5 + 0.5 * CONFIDENCE))
    return np.asarray(quantile * np.sqrt(variance))


def _effective_blocks(jacobian: Array, columns: int, blocks: Array) -> float:
    """How many blocks of equal information would be as good as these; at most all of them."""
    size = np.sqrt((jacobian**2).sum(axis=0))
    share = (jacobian / np.maximum(size, 1e-300)) ** 2
    of_row = np.repeat(blocks, columns)
    _, places = np.unique(of_row, return_inverse=True)
    parts = np.array([np.bincount(places, column) for column in share.T])
    return float((parts.sum(axis=1) ** 2 / np.maximum((parts**2).sum(axis=1), 1e-300)).min())


def _covariance(jacobian: Array, residual: Array, blocks: Array) -> Array:
    """Covariance of the parameters, of a Jacobian ``(samples * columns, parameters)`` of the residual."""
    count = jacobian.shape[1]
    out = np.full((count, count), np.inf)
    names = np.unique(blocks)
    size = np.sqrt((jacobian**2).sum(axis=0))
    used = np.flatnonzero(size > 1e-9 * max(float(size.max()), 1e-300))
    scaled = jacobian[:, used] / size[used]
    normal = scaled.T @ scaled
    if len(names) < 2 or np.linalg.cond(normal) > 1e12:
        return out
    of_row = np.repeat(blocks, residual.shape[1])
    left = residual.ravel()
    total = np.zeros((len(used), len(used)))
    for name in names:
        rows = of_row == name
        own = scaled[rows]
        rest = normal - own.T @ own
        if np.linalg.cond(rest) > 1e12:
            return out  # one block alone fixes a parameter: nothing is known of its error
        change = np.linalg.solve(rest, own.T @ left[rows])
        total += np.outer(change, change)
    share = (len(names) - 1.0) / len(names)
    out[np.ix_(used, used)] = share * total / np.outer(size[used], size[used])
    return out


@dataclass(frozen=True, slots=True)
class ErrorSize:
    """Size of errors: root mean square and its 95 % interval, by a bootstrap over pieces of time."""

    rmse: float
    low: float
    high: float


def error_of(residual: Array, pieces: Array) -> ErrorSize:
    """Errors ``(samples, columns)``, as lengths; ``pieces``: number of the piece of time of each sample."""
    squares = (residual**2).sum(axis=1)
    names, places = np.unique(pieces, return_inverse=True)
    total = np.bincount(places, squares)
    counts = np.bincount(places)
    drawn = np.random.default_rng(_SEED).integers(len(names), size=(_DRAWS, len(names)))
    draws = np.sqrt(total[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    low, high = np.quantile(draws, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    return ErrorSize(float(np.sqrt(squares.mean())), float(low), float(high))
