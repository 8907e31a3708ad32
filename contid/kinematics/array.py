"""The array type of the models, and what a tick computes with small ones.

NumPy's linear algebra (`numpy.linalg`) stays out of the tick: its calls cost more than arithmetic of a few
numbers, and BLAS may begin threads. ``tests/control/engine/test_no_numpy_linalg.py`` holds that.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.kernels import load

Array: TypeAlias = NDArray[np.float64]


def size_of(values: Array) -> float:
    """Root of the sum of the squares of all numbers."""
    flat = values.ravel()
    return math.sqrt(float(flat @ flat))


def step_lengths(points: Array) -> Array:
    """Distances of each of ``(n, 3)`` points from the one before, shape ``(n - 1,)``."""
    lengths: Array = np.sqrt(((points[1:] - points[:-1]) ** 2).sum(axis=1))
    return lengths


def polyline_length(points: Array) -> float:
    """Length of the line through ``(n, 3)`` points."""
    return float(step_lengths(points).sum())


def pseudo_inverse(matrix: Array, singular: float = 1e-15) -> Array:
    """Moore-Penrose inverse of a small matrix, by the kernel (``limiter/small_matrices.hpp``).

    Args:
        matrix: of at most 64 rows and columns.
        singular: singular values that count as none, as a share of the greatest.

    Raises:
        ValueError: The matrix is too large, or not all of it are numbers.
    """
    inverse = np.empty(matrix.shape[::-1])
    load("limiter").pseudo_inverse(np.ascontiguousarray(matrix), singular, inverse)
    return inverse
