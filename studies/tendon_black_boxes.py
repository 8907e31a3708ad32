"""Regressions without physics, as baselines of the tendon models: ridge and kernel ridge.

Inputs: pulls, and for the kernel also pulls after play of several widths, which carry the direction of
motion. Penalties and widths are chosen with patterns of the training rows kept out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.play_series import play_series
from contid_fit.calibrate.tendon.recording import TendonRecording

#: Training inputs, training outputs, inputs to predict at: predictions.
Method: TypeAlias = Callable[[Array, Array, Array], Array]

PLAYS_M: Final = (0.2e-3, 0.5e-3, 1e-3)
PENALTIES: Final = (1e-3, 1e-2, 1e-1, 1.0)
RIDGE_PENALTIES: Final = (0.1, 1.0, 10.0, 100.0, 1000.0)
WIDTHS: Final = (3.0, 6.0, 12.0)
FOLDS: Final = 5


def black_boxes(training: TendonRecording, held_out: TendonRecording) -> Iterator[tuple[str, Array]]:
    """Name and predicted tips ``(rows, 3)`` [m], training rows first."""
    pull = np.concatenate((training.pull_m, held_out.pull_m))
    first, tip = len(training), training.tip_m
    fold = (training.runs * FOLDS // (training.runs[-1] + 1.0)).astype(int)
    scale = pull[:first].std(axis=0)
    x = pull / scale
    a, b = np.triu_indices(pull.shape[1])
    terms = np.hstack((x, x[:, a] * x[:, b]))
    ridges = [partial(_ridge, penalty=each) for each in RIDGE_PENALTIES]
    yield (
        "ridge on pulls and their products",
        _best(ridges, terms[:first], tip, fold)(terms[:first], tip, terms),
    )
    states = np.hstack([x, *(play_series(pull, each) / scale for each in PLAYS_M)])
    kernels = [partial(_kernel, width=w, penalty=p) for w, p in itertools.product(WIDTHS, PENALTIES)]
    yield (
        "kernel ridge on pulls and play states",
        _best(kernels, states[:first], tip, fold)(states[:first], tip, states),
    )


def _best(methods: Sequence[Method], x: Array, y: Array, fold: NDArray[np.intp]) -> Method:
    """The method with the least error over all folds, each predicted from the others."""

    def error(method: Method) -> float:
        total = 0.0
        for each in range(FOLDS):
            out = fold == each
            total += float(((method(x[~out], y[~out], x[out]) - y[out]) ** 2).sum())
        return total

    return min(methods, key=error)


def _ridge(x: Array, y: Array, at: Array, penalty: float) -> Array:
    centre, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    design, mean = (x - centre) / scale, y.mean(axis=0)
    gain = np.linalg.solve(design.T @ design + penalty * np.eye(x.shape[1]), design.T @ (y - mean))
    out: Array = (at - centre) / scale @ gain + mean
    return out


def _kernel(x: Array, y: Array, at: Array, width: float, penalty: float) -> Array:
    mean = y.mean(axis=0)
    weights = np.linalg.solve(_gauss(x, x, width) + penalty * np.eye(len(x)), y - mean)
    out: Array = _gauss(at, x, width) @ weights + mean
    return out


def _gauss(a: Array, b: Array, width: float) -> Array:
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    out: Array = np.exp(-0.5 * np.maximum(square, 0.0) / width**2)
    return out
