"""The energy of a tendon rod over elements placed by matrix exponentials; its slopes are complex steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.linalg import expm

from contid.kinematics.tendon.rod import TendonRod


class Energy:
    """Energy of a rod [J], of strains that may be complex."""

    def __init__(self, rod: TendonRod, pulls: Any, force: Any) -> None:
        self.e, self.pulls, self.force = rod.discrete, np.array(pulls), np.array(force)
        self.free = np.tile(np.arange(4) < (4 if self.e.stretches else 3), len(self.e.lengths))

    def placed(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ends of the elements, the frame of the last one, and the tip."""
        frame = np.eye(4, dtype=x.dtype)
        frame[2, 3] = self.e.base_m
        points = [frame[:3, 3].copy()]
        u, v, t, e = x.reshape(-1, 4).T
        twists = np.zeros((len(u), 4, 4), dtype=x.dtype)
        twists[:, 0, 1], twists[:, 0, 2], twists[:, 1, 2] = -t, u, v
        twists[:, 1, 0], twists[:, 2, 0], twists[:, 2, 1] = t, -u, -v
        twists[:, 2, 3] = self.e.lengths * (1.0 + e)
        ahead = np.eye(4)
        for turned, rigid in zip(expm(twists), self.e.rigid, strict=True):
            ahead[2, 3] = rigid
            frame = frame @ turned @ ahead
            points.append(frame[:3, 3].copy())
        return np.array(points), frame[:3, :3], frame[:3, 3] + frame[:3, :3] @ self.e.offset

    def tensions(self, x: np.ndarray) -> np.ndarray:
        """Of the tendons [N]: never below 0."""
        shortening = np.zeros(len(self.pulls), dtype=x.dtype)
        for (u, v, t, e), h, arms in zip(x.reshape(-1, 4), self.e.lengths, self.e.arms, strict=True):
            for j, (a, b) in enumerate(arms):
                if not math.isnan(a):
                    along, around = 1.0 + e - (a * u + b * v) / h, math.hypot(a, b) * t / h
                    shortening[j] += h - h * np.sqrt(along * along + around * around)
        tension = self.e.rest + self.e.tendon * (self.pulls - shortening)
        return np.where(tension.real > 0.0, tension, 0.0)

    def value(self, x: np.ndarray) -> Any:
        points, _, tip = self.placed(x)
        elastic = 0.5 * np.sum(self.e.stiffness.ravel() * x * x)
        elastic += np.sum(self.tensions(x) ** 2 / (2.0 * self.e.tendon))
        # Half of an element's weight is at each of its ends.
        height = sum(0.5 * w @ (points[k] + points[k + 1]) for k, w in enumerate(self.e.weight))
        return elastic - height - self.force @ tip

    def gradient(self, x: np.ndarray) -> np.ndarray:
        steps = 1e-30j * np.eye(len(x))[self.free]
        return np.array([self.value(x + step).imag / 1e-30 for step in steps])

    def tip_by_strain(self, x: np.ndarray) -> np.ndarray:
        steps = 1e-30j * np.eye(len(x))[self.free]
        return np.array([self.placed(x + step)[2].imag / 1e-30 for step in steps]).T

    def hessian(self, x: np.ndarray) -> np.ndarray:
        columns = [
            (self.gradient(x + step) - self.gradient(x - step)) / 2e-5
            for step in 1e-5 * np.eye(len(x))[self.free]
        ]
        return np.stack(columns, axis=1)
