"""Solver of one rod: the compiled kernel (microseconds), or its specification in NumPy (milliseconds).

The kernel `contid.kernels._cosserat` is used when it can be imported and ``CONTID_PURE_PYTHON`` is not set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.effort import THOROUGH, TICK
from contid.kinematics.cosserat.branch import buckled, critical_factor
from contid.kinematics.cosserat.discretisation import fine_equilibrium
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.near import near_equilibrium
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.settled import search_settled
from contid.kinematics.cosserat.shape import frames_at
from contid.kinematics.cosserat.solve import Limits, Problem
from contid.kinematics.cosserat.task import Task
from contid.targets import Vec3

#: pressures, residual [mm], met, optimal, stable, iterations, elements, statics residual [N·mm], blocked by
#: stability, part of the path at which the arm snaps through (`snap_on_path`)
InverseAnswer: TypeAlias = tuple[tuple[float, ...], float, bool, bool, bool, int, int, float, bool, float]
#: tip, rotation (row-major), end of the first section, stable, base moment, elements
ForwardAnswer: TypeAlias = tuple[
    tuple[float, ...], tuple[float, ...], tuple[float, ...], bool, tuple[float, ...], int
]

#: tip, base moment, tip by the force on it [mm/N], tip by pressures [mm/bar]; matrices row-major
NearAnswer: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], tuple[float, ...]]

#: Part of the loads that the rod takes on its branch (1.0: all), base moment, elements
StaticsAnswer: TypeAlias = tuple[float, tuple[float, ...], int]

#: The kernel is compiled for one to this many sections.
KERNEL_SECTIONS = 8


@dataclass(frozen=True)
class RodSetup:
    """The rod, its own weight, limits and solver settings.

    ``thorough`` is False where searches for targets out of reach must fit into a few ticks.
    """

    rod: Rod
    weight: Loads
    limits: Limits
    elements: int
    error: float
    tolerance: float
    direction_length: float
    full_rotation: bool
    thorough: bool = True

    def loads(self, force: Vec3) -> Loads:
        """The arm's own weight and a force on the tip [N]."""
        return replace(self.weight, tip_force=np.array(force))


class RodSolver(Protocol):
    """Forward and inverse statics of one rod."""

    def inverse(
        self, tip: Vec3, mid: Vec3 | None, direction: Vec3 | None, force: Vec3, seed: Sequence[float]
    ) -> InverseAnswer:
        """Pressures [bar] for a task [mm] under a force on the tip [N], from the last commanded pressures."""
        ...

    def forward(self, pressures: Sequence[float], force: Vec3) -> ForwardAnswer:
        """Equilibrium of given pressures [bar] under a force on the tip [N]."""
        ...

    def near(self, pressures: Sequence[float], force: Vec3, guess: Sequence[float]) -> NearAnswer | None:
        """The stable equilibrium near a base moment [N·mm], in bounded time; None when there is none."""
        ...

    def statics(self, pressures: Sequence[float], loads: Loads, stations: Array, out: Array) -> StaticsAnswer:
        """Equilibrium under any dead loads, in place of the own weight.

        Position [mm] and rotation at ascending reference arc lengths [mm] are written to ``out``, (n, 12).
        """
        ...

    def critical(self, pressures: Sequence[float], force: Vec3, max_factor: float) -> float | None:
        """Least factor of the force at which the arm buckles; see `branch.critical_factor`."""
        ...


class NumpyEngine:
    """The specification."""

    def __init__(self, setup: RodSetup) -> None:
        self.setup = setup

    def inverse(
        self, tip: Vec3, mid: Vec3 | None, direction: Vec3 | None, force: Vec3, seed: Sequence[float]
    ) -> InverseAnswer:
        """See `RodSolver`."""
        s = self.setup
        task = Task(
            tip=np.array(tip),
            mid=None if mid is None else np.array(mid),
            direction=None if direction is None else np.array(direction),
            full_rotation=s.full_rotation,
            length=s.direction_length,
        )
        problem = Problem(s.rod, self.setup.loads(force), task, s.limits, s.elements, s.tolerance)
        found = search_settled(problem, np.array(seed), s.error, THOROUGH if s.thorough else TICK)
        o = found.outcome
        return (
            tuple(o.pressures.tolist()), o.residual, o.met, o.optimal, found.stable, found.iterations,
            found.elements, o.statics, o.blocked, found.snap,
        )  # fmt: skip

    def forward(self, pressures: Sequence[float], force: Vec3) -> ForwardAnswer:
        """See `RodSolver`."""
        s = self.setup
        loads = self.setup.loads(force)
        p: Array = np.array(pressures)
        found, elements = fine_equilibrium(s.rod, p, loads, s.elements, s.error)
        stable, end, moment = found.done == 1.0, found.sweep, found.base_moment
        if not stable:
            some = buckled(s.rod, p, loads, found, elements)
            end, moment = some.sweep, some.base_moment
        return (
            tuple(end.tip.tolist()), tuple(end.rotation.ravel().tolist()), tuple(end.ends[0].tolist()),
            stable, tuple(moment.tolist()), elements,
        )  # fmt: skip

    def near(self, pressures: Sequence[float], force: Vec3, guess: Sequence[float]) -> NearAnswer | None:
        """See `RodSolver`."""
        s = self.setup
        found = near_equilibrium(
            s.rod, np.array(pressures), self.setup.loads(force), np.array(guess), s.elements
        )
        if found is None:
            return None
        return (
            tuple(found.tip.tolist()), tuple(found.base_moment.tolist()),
            tuple(found.by_force.ravel().tolist()), tuple(found.by_pressure.ravel().tolist()),
        )  # fmt: skip

    def statics(self, pressures: Sequence[float], loads: Loads, stations: Array, out: Array) -> StaticsAnswer:
        """See `RodSolver`."""
        s = self.setup
        p: Array = np.array(pressures)
        found, elements = fine_equilibrium(s.rod, p, loads, s.elements, s.error)
        moment = found.base_moment
        if found.done < 1.0:
            moment = buckled(s.rod, p, loads, found, elements).base_moment
        out[:] = frames_at(s.rod, p, moment, loads, elements, stations)
        return found.done, tuple(moment.tolist()), elements

    def critical(self, pressures: Sequence[float], force: Vec3, max_factor: float) -> float | None:
        """See `RodSolver`."""
        return critical_factor(
            self.setup.rod, np.array(pressures), self.setup.loads(force), max_factor, self.setup.elements
        )


def build_engine(setup: RodSetup) -> RodSolver:
    """The kernel where available, else NumPy, where a thorough search would take a minute."""
    kernel = load("cosserat") if len(setup.rod.sections) <= KERNEL_SECTIONS else None
    if kernel is None:
        return NumpyEngine(replace(setup, thorough=False))
    engine: RodSolver = kernel.Engine(setup)
    return engine
