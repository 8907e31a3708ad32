"""Tables II and III of Singh et al. (IROS 2018) beside today: tube lengths from the pose of the tip.

The paper compares its Pythagorean-hodograph method with Newton-Raphson by the total lengths of the tubes (a
tip pose does not determine six lengths). The first uses the tip's direction, the second does not: the table
lists the inputs of each method. Everything is simulated, on the arm with constant curvature per section.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.array import Array
from contid.targets import Vec3
from contid_ropes.ph.model import ShapeInverse, TubeSection, arc_direction
from studies import singh
from studies.arc_chains import biarc, forward, lengths_of
from studies.comparison import cbha

#: Six lengths from: tip, direction, true lengths (for methods with a known length), previous lengths.
ShapeStep: TypeAlias = Callable[[Array, Array, Array, Array], Array]

_SECTIONS: Final = singh.cbha_sections()


@dataclass(frozen=True, slots=True)
class ShapeMethod:
    """One way from poses to tube lengths, what it is given, and what Table II prints of it [mm, mm, us]."""

    name: str
    given: str
    step: ShapeStep
    paper_max_mm: tuple[float, float, float] | None = None
    paper_mean_mm: tuple[float, float, float] | None = None
    paper_us: float | None = None


@dataclass(frozen=True, slots=True)
class ShapeRow:
    """Results of one method; errors of lengths in mm, time in us.

    Attributes:
        name, given: of the method.
        max_mm, mean_mm: of the total of each tube.
        six_max_mm, six_mean_mm: of the six lengths.
        tip_max_mm, tip_mean_mm: between the tip of these lengths (constant curvature) and the true one.
        time_us: median time per pose, called from Python.
        paper_max_mm, paper_mean_mm, paper_us: as printed, on the authors' robot and computer.
    """

    name: str
    given: str
    max_mm: tuple[float, ...]
    mean_mm: tuple[float, ...]
    six_max_mm: float
    six_mean_mm: float
    tip_max_mm: float
    tip_mean_mm: float
    time_us: float
    paper_max_mm: tuple[float, float, float] | None
    paper_mean_mm: tuple[float, float, float] | None
    paper_us: float | None


def vec3(row: Array) -> Vec3:
    """Three numbers as Python's floats."""
    x, y, z = row.tolist()
    return x, y, z


def tube_sections() -> tuple[TubeSection, ...]:
    """The reference's CBHA as the method by shape takes it."""
    angles = _SECTIONS.angles_rad
    return tuple(TubeSection(d, each) for d, each in zip(_SECTIONS.radius_m, angles, strict=True))


def split_of(lengths: Array) -> tuple[float, float]:
    """Share of each section in the backbone."""
    first, second = float(lengths[:3].sum()), float(lengths[3:].sum())
    return first / (first + second), second / (first + second)


def shape_methods() -> list[ShapeMethod]:
    """Every method of the comparison."""
    middle = 0.5 * (np.array(singh.LOWER_M) + np.array(singh.UPPER_M))
    prepared = ShapeInverse(tube_sections(), split_of(middle))
    bounded = build_solver(cbha())

    def unknown(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        return np.array(prepared.solve(vec3(tip), vec3(direction)).lengths_m)

    def alone(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        return np.array(prepared.solve(vec3(tip), arc_direction(vec3(tip))).lengths_m)

    def known(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        solver = ShapeInverse(tube_sections(), split_of(true))
        return np.array(solver.solve(vec3(tip), vec3(direction), float(true.sum()) / 3.0).lengths_m)

    def newton(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        return singh.newton_raphson(_SECTIONS, tip, before)[0]

    def two_arcs(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        arcs = biarc(tip, direction, 0.5 * float(middle[0]), (0.0, 0.0))
        return before if arcs is None else lengths_of(_SECTIONS, np.array(arcs))

    def both(tip: Array, direction: Array, true: Array, before: Array) -> Array:
        return np.array(bounded.solve(vec3(tip), vec3(direction), None, tuple(before.tolist())).lengths)

    return [
        ShapeMethod(
            "PH quintic (native)", "tip, direction", unknown, (4.40, 5.23, 3.60), (2.82, 2.20, 0.98), 270.0
        ),
        ShapeMethod("PH quintic (native)", "tip, direction, length, split", known),
        ShapeMethod("PH quintic, direction of one arc (native)", "tip", alone),
        ShapeMethod("Newton-Raphson (NumPy)", "tip", newton, (13.2, 7.5, 9.9), (6.39, 3.94, 6.24), 233_500.0),
        ShapeMethod("biarc, middle control leg (NumPy)", "tip, direction", two_arcs),
        ShapeMethod("contid, bounded", "tip, direction", both),
    ]


def compare_shapes(noise_mm: float = 0.0, noise_deg: float = 0.0, laps: int = 1) -> list[ShapeRow]:
    """Every method on the golden trajectory.

    Args:
        noise_mm: standard deviation of each coordinate of the measured tip.
        noise_deg: standard deviation of the angle by which the measured direction is off, to each side.
        laps: repetitions of the trajectory, each with other noise.
    """
    golden = singh.golden_trajectory()
    frames = forward(_SECTIONS, golden.lengths_m)
    rows = []
    for method in shape_methods():
        rng = np.random.default_rng(2018)
        errors, missed, spent = [], [], []
        for _ in range(laps):
            before = golden.lengths_m[0]
            for k, true in enumerate(golden.lengths_m[1:], start=1):
                tip = frames.tip[k] + 1e-3 * noise_mm * rng.standard_normal(3)
                direction = _tilted(frames.rotation[k], np.radians(noise_deg) * rng.standard_normal(2))
                begin = time.perf_counter_ns()
                before = method.step(tip, direction, true, before)
                spent.append(time.perf_counter_ns() - begin)
                errors.append(1e3 * (before - true))
                missed.append(1e3 * float(np.linalg.norm(forward(_SECTIONS, before).tip - frames.tip[k])))
        six = np.array(errors)
        totals = np.abs(six[:, :3] + six[:, 3:])
        rows.append(
            ShapeRow(
                method.name,
                method.given,
                tuple(totals.max(axis=0).tolist()),
                tuple(totals.mean(axis=0).tolist()),
                float(np.abs(six).max()),
                float(np.abs(six).mean()),
                max(missed),
                statistics.fmean(missed),
                1e-3 * statistics.median(spent),
                method.paper_max_mm,
                method.paper_mean_mm,
                method.paper_us,
            )
        )
    return rows


def _tilted(rotation: Array, angles_rad: Array) -> Array:
    """The tip's direction, off by two small angles about its own x and y."""
    off: Array = rotation @ np.array([angles_rad[0], angles_rad[1], 1.0])
    return off / np.linalg.norm(off)
