"""Golden values of part E in SI, from tests/reference (lengths there are in mm)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from contid_ropes.ph.ends import quintic_between
from contid_ropes.ph.lift import lift, nearest, product, turned
from contid_ropes.ph.quintic import PhQuintic

MM = 1e-3
GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "reference" / "cbha-and-ph-golden.json").read_text()
)
DISTANCE = np.array(GOLDEN["params"]["d"]) * MM
PAPER_ANGLES = np.radians(GOLDEN["params"]["alpha_paper_deg"])


def section_pose(
    l_m: np.ndarray, d: float, angles: np.ndarray = PAPER_ANGLES
) -> tuple[np.ndarray, np.ndarray]:
    """Tip and rotation of one constant-curvature section (reference C.2), the slow obvious way."""
    L = float(np.mean(l_m))
    u = -2.0 / (3.0 * d) * float((l_m - L) @ np.cos(angles))
    v = -2.0 / (3.0 * d) * float((l_m - L) @ np.sin(angles))
    q = u * u + v * v
    th = np.sqrt(q)
    A = np.sin(th) / th if th > 1e-6 else 1.0 - q / 6.0
    B = (1.0 - np.cos(th)) / q if th > 1e-4 else 0.5 - q / 24.0
    R = np.array([
        [1 - u * u * B, -u * v * B, u * A],
        [-u * v * B, 1 - v * v * B, v * A],
        [-u * A, -v * A, 1 - q * B],
    ])  # fmt: skip
    return L * np.array([u * B, v * B, A]), R


def two_section_pose(l_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tip, tangent and mid-point of the two-section arm with the golden parameters."""
    p1, r1 = section_pose(np.asarray(l_m[:3]), DISTANCE[0])
    p2, r2 = section_pose(np.asarray(l_m[3:]), DISTANCE[1])
    return p1 + r1 @ p2, (r1 @ r2)[:, 2], p1


def golden_lengths(steps: int = 100) -> np.ndarray:
    """The reference's trajectory of tube lengths (part C.4) [m], shape ``(steps, 6)``."""
    tau = np.arange(steps) / (steps - 1)
    fa, pa = np.array([1.3, 0.9, 1.7, 1.1, 0.7, 1.5]), np.array([0.3, 2.1, 4.4, 5.2, 1.2, 3.3])
    fb, pb = np.array([2.3, 2.9, 1.9, 3.1, 2.7, 2.1]), np.array([1.0, 0.2, 5.5, 2.6, 4.0, 0.9])
    turn = 2 * np.pi * tau[:, None]
    pressure = 0.75 + 0.45 * np.sin(turn * fa + pa) + 0.25 * np.sin(turn * fb + pb)
    x = pressure / 1.5
    lo, hi = np.array(GOLDEN["params"]["lo"]), np.array(GOLDEN["params"]["hi"])
    result: np.ndarray = (lo + (hi - lo) * x * (1 + 0.3 * (1 - x))) * MM
    return result


def hermite(
    start_m: np.ndarray,
    end_m: np.ndarray,
    start_derivative: np.ndarray,
    end_derivative: np.ndarray,
    beta: float = 0.0,
    gamma: float = 0.0,
) -> PhQuintic:
    """The quintic with given end points and end derivatives (vectors, size included)."""
    chord = end_m - start_m
    a0 = lift(start_derivative)
    a2 = lift(end_derivative)
    a2 = nearest(a2, a0, chord)
    a2 = turned(a2, math.cos(beta), math.sin(beta))
    c = 120.0 * chord - 15.0 * (start_derivative + end_derivative) + 10.0 * product(a0, a2)
    return quintic_between(start_m, chord, a0, a2, c, gamma)


def curvature(curve: PhQuintic, t: np.ndarray) -> np.ndarray:
    """Curvature [1/m] from the angular rates, shape (n,)."""
    _, k2, k3 = curve.rates(t)
    return np.hypot(k2, k3) / curve.speed(t)
