"""Photographs of the curvature calibration: marker positions by the line of Morita et al., with noise."""

from __future__ import annotations

import math

import numpy as np

from contid.kinematics.rack.planar_arc import cosc, sinc

A, B = 0.0013, -0.2774
PX_PER_MM = 5.0  # 250 pixels correspond to 50 mm


def markers(arc_length_mm: float, curvature_per_mm: float, count: int = 12) -> np.ndarray:
    s = np.linspace(0, arc_length_mm, count)
    return np.array([[v * cosc(curvature_per_mm * v), v * sinc(curvature_per_mm * v)] for v in s])


def photograph(noise_px: float, seed: int = 3) -> str:
    """Markers of the paper's protocol: k_d = 0.01..0.05 at S = 40..100 mm, in a turned and shifted camera."""
    rng = np.random.default_rng(seed)
    lines = ["posture,left_mm,right_mm,x_px,y_px"]
    turn = np.array([[math.cos(0.3), -math.sin(0.3)], [math.sin(0.3), math.cos(0.3)]])
    for s in (40, 55, 70, 85, 100):
        for k_d in (0.01, 0.02, 0.03, 0.04, 0.05):
            racks = f"{s * (1 - k_d * 6.5)!r},{s * (1 + k_d * 6.5)!r}"
            points = markers(s, k_d * (1 + A * s + B)) @ turn.T * PX_PER_MM + (700, 400)
            points = points + rng.normal(0, noise_px, points.shape)
            lines += [f"S{s} k{k_d},{racks},{x!r},{y!r}" for x, y in points.tolist()]
    return "\n".join(lines) + "\n"
