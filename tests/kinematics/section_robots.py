"""Robots the section tests share, and their numbers in the reference's millimetres."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.sections import Sections
from contid.kinematics.arc.solver import Solver

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "reference" / "cbha-and-ph-golden.json").read_text()
)
PAPER = (math.pi, math.pi / 3, -math.pi / 3)
CCW = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
#: phi = 180 degrees, clockwise: racks at -180, -60 and -300 degrees.
RACKS = (-math.pi, -math.pi / 3, -5 * math.pi / 3)


def cbha_sections(angles: tuple[float, float, float] = PAPER) -> Sections:
    return Sections((0.040, 0.032), (angles, angles), (0.0, 0.0))


def cbha() -> Feasible:
    return Feasible(cbha_sections(), (0.100, 0.090), (0.150, 0.140))


def one_segment() -> Feasible:
    return Feasible(Sections((0.035,), (RACKS,), (0.0,)), (0.050,), (0.650,))


def bounded_segment() -> Feasible:
    return Feasible(Sections((0.035,), (RACKS,), (0.0,)), (0.050,), (0.650,), curvature_max=1 / 0.12)


def two_segments() -> Feasible:
    """With everything: platform between the segments, rack budget, bend radius."""
    sections = Sections((0.035, 0.035), (RACKS, RACKS), (0.030, 0.0))
    return Feasible(sections, (0.010, 0.010), (0.650, 0.650), rack_m=0.790, curvature_max=1 / 0.12)


ROBOTS = {"cbha": cbha, "tri-rack": bounded_segment, "tri-rack 2": two_segments}


def random_lengths(feasible: Feasible, count: int, seed: int = 1) -> np.ndarray:
    """Postures inside every limit, dense up to the limits."""
    rng = np.random.default_rng(seed)
    cube = rng.random((count, len(feasible.low)))
    return np.array([feasible.pulled(feasible.low + c * (feasible.high - feasible.low)) for c in cube])


def free_solver(sections: Sections) -> Solver:
    """The kernel of a chain with limits far off: tubes of -1 to 3 m."""
    return build_solver(Feasible(sections, (-1.0,) * sections.count, (3.0,) * sections.count))


def placed(sections: Sections, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip [m] and its frame by the kernel."""
    found = free_solver(sections).forward(tuple(np.ravel(lengths).tolist()))
    return np.array(found.tip), np.reshape(found.rotation, (3, 3))


def derivatives(sections: Sections, lengths: np.ndarray) -> np.ndarray:
    """Jacobians of tip, orientation and mid-point by the kernel, ``(3, 3, N)``."""
    arrays = np.empty((3, 3, np.size(lengths)))
    free_solver(sections).differentiate(tuple(np.ravel(lengths).tolist()), *arrays)
    return arrays
