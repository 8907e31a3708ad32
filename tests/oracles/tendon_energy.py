"""The energy of a tendon rod over elements placed by matrix exponentials; its slopes are complex steps.

Strains are rows of a table, which may be complex, so that all steps of a gradient are computed side by side.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from contid_tendons.rod import TendonRod
from tests.oracles.twists import exponential


class Energy:
    """Energy of a rod [J], of strains that may be complex."""

    def __init__(self, rod: TendonRod, pulls: Any, force: Any) -> None:
        self.e, self.pulls, self.force = rod.discrete, np.array(pulls), np.array(force)
        self.free = np.tile(np.arange(4) < (4 if self.e.stretches else 3), len(self.e.lengths))

    def placed(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ends of the elements, the frame of the last one, and the tip; of each row of strains."""
        strain = x.reshape(*x.shape[:-1], -1, 4)
        u, v, t, e = np.moveaxis(strain, -1, 0)
        twists = np.zeros((*u.shape, 4, 4), dtype=x.dtype)
        twists[..., 0, 1], twists[..., 0, 2], twists[..., 1, 2] = -t, u, v
        twists[..., 1, 0], twists[..., 2, 0], twists[..., 2, 1] = t, -u, -v
        twists[..., 2, 3] = self.e.lengths * (1.0 + e)
        turned = exponential(twists)
        frame = np.broadcast_to(np.eye(4), (*x.shape[:-1], 4, 4)).astype(x.dtype)
        frame[..., 2, 3] = self.e.base_m
        points = [frame[..., :3, 3]]
        for k, rigid in enumerate(self.e.rigid):
            ahead = np.eye(4)
            ahead[2, 3] = rigid
            frame = frame @ turned[..., k, :, :] @ ahead
            points.append(frame[..., :3, 3])
        tip = frame[..., :3, 3] + frame[..., :3, :3] @ self.e.offset
        return np.stack(points, axis=-2), frame[..., :3, :3], tip

    def tensions(self, x: np.ndarray) -> np.ndarray:
        """Of the tendons [N]: never below 0."""
        u, v, t, e = np.moveaxis(x.reshape(*x.shape[:-1], -1, 4), -1, 0)[..., None]
        h, (a, b) = self.e.lengths[:, None], np.moveaxis(np.nan_to_num(self.e.arms), -1, 0)
        along, around = 1.0 + e - (a * u + b * v) / h, np.hypot(a, b) * t / h
        shorter = np.where(np.isnan(self.e.arms[..., 0]), 0.0, h - h * np.sqrt(along**2 + around**2))
        tension = self.e.rest + self.e.tendon * (self.pulls - shorter.sum(axis=-2))
        return np.where(tension.real > 0.0, tension, 0.0)

    def value(self, x: np.ndarray) -> Any:
        """Of each row of strains."""
        points, _, tip = self.placed(x)
        elastic = 0.5 * np.sum(self.e.stiffness.ravel() * x * x, axis=-1)
        elastic = elastic + np.sum(self.tensions(x) ** 2 / (2.0 * self.e.tendon), axis=-1)
        # Half of an element's weight is at each of its ends.
        middle = 0.5 * (points[..., :-1, :] + points[..., 1:, :])
        return elastic - np.sum(middle * self.e.weight, axis=(-2, -1)) - tip @ self.force

    def _steps(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(x[..., None, :] + 1e-30j * np.eye(x.shape[-1])[self.free])

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """By the free strains, of each row."""
        return np.asarray(self.value(self._steps(x)).imag / 1e-30)

    def tip_by_strain(self, x: np.ndarray) -> np.ndarray:
        """Derivative of the tip ``(3, free)``."""
        return np.asarray(self.placed(self._steps(x))[2].imag.T / 1e-30)

    def hessian(self, x: np.ndarray) -> np.ndarray:
        """By differences of the gradient, ``(free, free)``."""
        step = 1e-5 * np.eye(len(x))[self.free]
        return np.asarray((self.gradient(x + step) - self.gradient(x - step)) / 2e-5)
