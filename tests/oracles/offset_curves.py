"""The length of a tube beside a curve, drawn point by point in a frame that does not turn about the tangent.

The frame is carried along by double reflection (Wang et al., ACM Transactions on Graphics 27(1), 2008), which
shares nothing with the integrals of the kernel; Richardson's extrapolation sharpens the polygon.
"""

from __future__ import annotations

import math

import numpy as np

from contid_ropes.ph.quintic import PhQuintic


def carried(points: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """First axis of the frame at each point, x of the base at the first one, ``(n, 3)``."""
    first = np.array((1.0, 0.0, 0.0))
    first -= (first @ tangents[0]) * tangents[0]
    axes = [first / np.linalg.norm(first)]
    for p, q, t, s in zip(points[:-1], points[1:], tangents[:-1], tangents[1:], strict=True):
        v = q - p
        by = 2.0 / (v @ v)
        axis, tangent = axes[-1] - by * (v @ axes[-1]) * v, t - by * (v @ t) * v
        w = s - tangent
        axes.append(axis - (2.0 / (w @ w) * (w @ axis) * w if w @ w > 0.0 else 0.0))
    return np.array(axes)


def tube_length(curve: PhQuintic, begin_m: float, end_m: float, distance_m: float, angle_rad: float) -> float:
    """Of a tube at an azimuth and a distance, between two arc lengths of the backbone [m]."""
    return (4.0 * _polygon(curve, begin_m, end_m, distance_m, angle_rad, 400) - _polygon(
        curve, begin_m, end_m, distance_m, angle_rad, 200
    )) / 3.0  # fmt: skip


def _polygon(
    curve: PhQuintic, begin_m: float, end_m: float, distance_m: float, angle_rad: float, pieces: int
) -> float:
    before = np.linspace(0.0, begin_m, pieces + 1) if begin_m > 0.0 else np.zeros(1)
    s = np.concatenate((before[:-1], np.linspace(begin_m, end_m, pieces + 1)))
    t = curve.parameter_at(s)
    points, tangents = curve.point(t), curve.tangent(t)
    x = carried(points, tangents)
    beside = points + distance_m * (math.cos(angle_rad) * x + math.sin(angle_rad) * np.cross(tangents, x))
    steps = np.diff(beside, axis=0)[len(before) - 1 :]
    return float(np.linalg.norm(steps, axis=1).sum())
