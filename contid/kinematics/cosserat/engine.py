"""Solver of one rod: the compiled kernel ``contid/kernels/cosserat``, in mm, N, N·mm and bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Loads, Rod
from contid.targets import Vec3

#: A table of rows, shape ``(rows, bytes of a row)``.
Bytes: TypeAlias = NDArray[np.uint8]
#: `InverseAnswer.snap` where the arm gets to the answer on a straight path without snapping through.
NO_SNAP: Final = 2.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds and centre of the pressures [bar], shape (3k,) each; redundancy prefers the centre."""

    lower: Array
    upper: Array
    centre: Array


@dataclass(frozen=True, slots=True)
class RodSetup:
    """The rod of one to eight sections, its own weight, limits and solver settings.

    Attributes:
        elements: integration steps per section to begin with.
        error: estimated error of tip and mid-point [mm] above which the steps are doubled.
        tolerance: task error that counts as met [mm].
        direction_length: length that scales the error of a direction to mm.
        full_rotation: a direction stands for the whole twist-free frame.
        thorough: False where searches for targets out of reach must fit into a few ticks.
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


class InverseAnswer(NamedTuple):
    """Pressures for a target.

    Attributes:
        pressures_bar: inside the limits.
        residual_mm: norm of the task error.
        met: task and equilibrium hold to their tolerances.
        optimal: no feasible change reduces the task error further (always when met).
        stable: the equilibrium is a minimum of energy.
        iterations: sweeps with derivatives and their like.
        elements: integration steps per section.
        balance_nmm: norm of the moment balance at the tip.
        blocked: the last steps led out of the stable equilibria.
        snap: part of the straight path to an equilibrium on the target at which the arm snaps through; 1
            where it ends elsewhere without a snap, `NO_SNAP` where it gets there.
    """

    pressures_bar: tuple[float, ...]
    residual_mm: float
    met: bool
    optimal: bool
    stable: bool
    iterations: int
    elements: int
    balance_nmm: float
    blocked: bool
    snap: float


class ForwardAnswer(NamedTuple):
    """An equilibrium: tip, its frame by rows, end of the first section, and moment at the base."""

    tip_mm: Vec3
    rotation: tuple[float, ...]
    mid_mm: Vec3
    stable: bool
    base_moment_nmm: Vec3
    elements: int


class NearAnswer(NamedTuple):
    """An equilibrium near a known one; derivatives of its tip by the force and by pressures, by rows."""

    tip_mm: Vec3
    base_moment_nmm: Vec3
    by_force_mm_n: tuple[float, ...]
    by_pressure_mm_bar: tuple[float, ...]


class StaticsAnswer(NamedTuple):
    """Part of the loads that the rod takes on its branch (1.0: all), base moment, steps per section."""

    carried: float
    base_moment_nmm: Vec3
    elements: int


class RodSolver:
    """Forward and inverse statics of one rod.

    Raises:
        KernelMissingError: The kernel is not compiled in this installation.
        ValueError: The rod has more than eight sections, or none.
    """

    def __init__(self, setup: RodSetup) -> None:
        self.setup = setup
        self._kernel: Any = load("cosserat").Engine(setup)

    def inverse(
        self, tip: Vec3, mid: Vec3 | None, direction: Vec3 | None, force: Vec3, seed: Sequence[float]
    ) -> InverseAnswer:
        """Pressures [bar] for a task [mm] under a force on the tip [N], from the last commanded pressures."""
        return InverseAnswer(*self._kernel.inverse(tip, mid, direction, force, seed))

    def forward(self, pressures: Sequence[float], force: Vec3) -> ForwardAnswer:
        """Equilibrium reached when pressures [bar], own weight and a force on the tip [N] grow together.

        Where it loses its stability on the way, ``stable`` is False and the equilibrium is another one.
        """
        return ForwardAnswer(*self._kernel.forward(pressures, force))

    def near(self, pressures: Sequence[float], force: Vec3, guess: Sequence[float]) -> NearAnswer | None:
        """The stable equilibrium near a base moment [N·mm], in bounded time; None when there is none."""
        found = self._kernel.near(pressures, force, guess)
        return None if found is None else NearAnswer(*found)

    def statics(self, pressures: Sequence[float], loads: Loads, stations: Array, out: Array) -> StaticsAnswer:
        """Equilibrium under any dead loads, in place of the own weight.

        Position [mm] and rotation at ascending reference arc lengths [mm] are written to ``out``, (n, 12).
        """
        return StaticsAnswer(*self._kernel.statics(pressures, loads, stations, out))

    def bends(self, pressures: Sequence[float], force: Vec3) -> tuple[float, ...]:
        """Components of the bend [rad] and length [mm] of every section (``bends.hpp``) in equilibrium."""
        found: tuple[float, ...] = self._kernel.bends(pressures, force)
        return found

    def of_bends(
        self, asked: Sequence[float], force: Vec3, seed: Sequence[float]
    ) -> tuple[float, ...] | None:
        """Pressures [bar] that have bends and lengths, 0 for an open one; None where none were found."""
        found: tuple[float, ...] | None = self._kernel.of_bends(asked, force, seed)
        return found

    def critical(self, pressures: Sequence[float], force: Vec3, max_factor: float) -> float | None:
        """Least factor of the force, up to ``max_factor``, at which the arm buckles, to 0.5 %.

        Pressures and own weight act in full: 0.0 where these suffice. None where the arm stays stable.
        """
        factor: float | None = self._kernel.critical(pressures, force, max_factor)
        return factor

    def forward_many(self, pressures: Array, force: Array | None, out: Bytes, threads: int) -> None:
        """`forward` of rows of pressures and forces; ``out``: bytes of rows of `batch.rows.POSE`."""
        self._kernel.forward_many(pressures, force, out, threads)

    def inverse_many(
        self,
        tip: Array,
        mid: Array | None,
        direction: Array | None,
        force: Array | None,
        seeds: Array,
        out: Bytes,
        threads: int,
    ) -> None:
        """`inverse` of rows; ``out``: bytes of rows of `batch.rows.solution_dtype`."""
        self._kernel.inverse_many(tip, mid, direction, force, seeds, out, threads)
