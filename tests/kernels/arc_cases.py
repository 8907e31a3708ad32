"""Arms that the tests of the solver of arcs share, their targets, and the metric of home."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.sections import Sections
from contid.kinematics.arc.solver import SectionSolution, Solver
from tests.kinematics.section_robots import RACKS, ROBOTS
from tests.oracles import twists


def three_segments() -> Feasible:
    """Every limit and three sections: the build for any number of them."""
    sections = Sections((0.035,) * 3, (RACKS,) * 3, (0.030, 0.020, 0.010))
    return Feasible(sections, (0.010,) * 3, (0.450,) * 3, rack_m=0.850, curvature_max=1 / 0.12)


ARMS = {**ROBOTS, "tri-rack 3": three_segments}
MODES = {"tri-rack": ("tip",), "cbha": ("tip", "direction", "mid"), "tri-rack 2": ("tip", "direction", "mid")}
MODES["tri-rack 3"] = ("tip", "direction", "mid", "rotation", "direction and mid")
CASES = [(name, mode) for name, modes in MODES.items() for mode in modes]


def metric(feasible: Feasible) -> np.ndarray:
    """Of the distance from home: ``3 (L - L0)^2 + max(1.5 d^2, L0^2/2) theta^2`` per section."""
    blocks = np.zeros((len(feasible.low), len(feasible.low)))
    for s, (d, angles) in enumerate(
        zip(feasible.sections.radius_m, feasible.sections.angles_rad, strict=True)
    ):
        by_arc = np.array([[-d * math.cos(a), -d * math.sin(a), 1.0] for a in angles])
        to_arc = np.linalg.inv(by_arc)
        bend = max(1.5 * d * d, 0.5 * float(feasible.home[3 * s]) ** 2)
        part = slice(3 * s, 3 * s + 3)
        blocks[part, part] = to_arc.T @ np.diag((bend, bend, 3.0)) @ to_arc
    return blocks


def target_of(feasible: Feasible, lengths: np.ndarray, mode: str) -> dict[str, Any]:
    """Tip and what else a mode asks for, of lengths."""
    at = twists.of_tubes(feasible.sections).placed(lengths)
    target: dict[str, Any] = {"tip": tuple(at.tip.tolist()), "direction": None, "mid": None, "rotation": None}
    if "direction" in mode:
        target["direction"] = tuple(at.rotation[:, 2].tolist())
    if "mid" in mode:
        target["mid"] = tuple(at.mid.tolist())
    if mode == "rotation":
        target["rotation"] = tuple(at.rotation.ravel().tolist())
    return target


def solved(solver: Solver, target: dict[str, Any], seed: np.ndarray) -> SectionSolution:
    return solver.solve(
        target["tip"], target["direction"], target["mid"], tuple(seed.tolist()), target["rotation"]
    )
