"""Limits of tube arms and of tendon robots by their definitions: excess and outward normals of each."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.tendon.feasible import TendonFeasible

#: One limit: how far it is exceeded [m], of variables that may be complex.
Limit = Callable[[np.ndarray], complex]


def of_tubes(feasible: Feasible) -> list[Limit]:
    """Intervals of tubes, then sums of racks, then bend radii, in the order of the bits of an answer."""
    sections, size = feasible.sections, len(feasible.low)
    limits: list[Limit] = [lambda l, i=i: feasible.lower[i // 3] - l[i] for i in range(size)]  # type: ignore[misc]
    limits += [lambda l, i=i: l[i] - feasible.upper[i // 3] for i in range(size)]  # type: ignore[misc]
    limits += [lambda l, j=j: sum(l[j::3]) - feasible.rack_m for j in range(3)]  # type: ignore[misc]
    for s, (d, angles) in enumerate(zip(sections.radius_m, sections.angles_rad, strict=True)):
        rows = np.array([[-d * math.cos(a), -d * math.sin(a), 1.0] for a in angles])

        def bend(l: np.ndarray, s: int = s, d: float = d, rows: np.ndarray = rows) -> complex:
            u, v, length = np.linalg.solve(rows, l[3 * s : 3 * s + 3])
            if feasible.curvature_max == math.inf:
                return -math.inf
            return complex(d * (np.sqrt(u * u + v * v) - feasible.curvature_max * length))

        limits.append(bend)
    return limits


def of_bends(feasible: TendonFeasible) -> list[Limit]:
    """Planes, then the bend of each section."""
    limits: list[Limit] = [
        lambda x, a=a, b=b: a @ x - b  # type: ignore[misc]
        for a, b in zip(feasible.normals, feasible.offsets, strict=True)
    ]
    for s, (length, most) in enumerate(zip(feasible.sections.backbone_m, feasible.bend_max_rad, strict=True)):
        limits.append(
            lambda x, s=s, length=length, most=most: (  # type: ignore[misc]
                np.sqrt(x[2 * s] ** 2 + x[2 * s + 1] ** 2) - length * most
            )
        )
    return limits


def excess(limits: list[Limit], at: np.ndarray) -> np.ndarray:
    """By how much each limit is exceeded [m]."""
    return np.array([np.real(limit(at)) for limit in limits])


def binding_normals(limits: list[Limit], at: np.ndarray, within_m: float = 1e-7) -> np.ndarray:
    """Gradients of the limits of which less than this is left, by complex steps, ``(limits, N)``."""
    rows = []
    for limit in limits:
        if np.real(limit(at)) > -within_m:
            steps = 1e-30j * np.eye(len(at))
            rows.append([np.imag(limit(at + step)) / 1e-30 for step in steps])
    return np.reshape(rows, (-1, len(at)))
