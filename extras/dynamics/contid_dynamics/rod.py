"""A rod in motion: elements of constant strain with mass, the kernel ``contid/kernels/dynamics``.

The unknowns are the strains of the elements: bends u, v, twist [rad], stretch, and shears, as in
`contid_tendons.rod`. ``rod_motion.hpp`` derives the steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.targets import ZERO3, Vec3

#: Numbers per element in arrays of strains.
STRAINS: Final = 6
#: Simpson's rule: shares of an element's mass at each of its ends and in its middle.
_END, _MIDDLE = 1.0 / 6.0, 4.0 / 6.0


@dataclass(frozen=True, eq=False)
class MovingElements:
    """Elements of a rod with their masses; the kernel reads the fields by name.

    Attributes:
        lengths: lengths of the elements [m], shape ``(elements,)``.
        rigid: length of the rigid piece after each [m].
        strains: 3 for bends and twist, 4 with stretch, 6 with shear.
        middles: mass [kg] and second moment [kg m^2] in the middle of each, ``(elements, 2)``.
        ends: the same at the end of each.
        arms: lever arms of tendons [m], NaN where one does not pass, ``(elements, tendons, 2)``.
        tendon: stiffness of each tendon [N/m].
        rest: tensions of the straight rod at zero pulls [N].
        base_m: length before the first element [m].
    """

    lengths: Array
    rigid: Array
    strains: int
    middles: Array
    ends: Array
    arms: Array
    tendon: Array
    rest: Array
    base_m: float = 0.0


class Modes(NamedTuple):
    """Small motions about an equilibrium, slowest first.

    Attributes:
        frequency_hz: undamped frequencies, shape ``(modes,)``.
        ratio: damping ratios.
        strain: shapes, changes of the free strains at unit modal mass, ``(modes, free)``.
    """

    frequency_hz: Array
    ratio: Array
    strain: Array


class MotionKernel(Protocol):
    """Interface of the compiled rod; see ``contid/kernels/dynamics/dynamics.cpp``."""

    @property
    def free(self) -> int:
        """Number of free strains."""

    def load(
        self, gravity: Sequence[float], nodes: Array, strains: Array, pulls: Array, within_s: float
    ) -> None:
        """Set what acts from now on."""

    def stiffen(self, stiffness: Array, damping_s: float) -> None:
        """Set the stiffness of the strains, and the time of their damping."""

    def put(self, strains: Array) -> None:
        """Take strains at rest."""

    def settle(self) -> bool:
        """Go to the equilibrium."""

    def run(self, step: float, every: int, nodes: Sequence[int], poses: Array) -> int:
        """Make steps and keep poses."""

    def poses(self, out: Array) -> None:
        """Poses of all nodes."""

    def state(self, strain: Array, momentum: Array) -> None:
        """Strains and momenta."""

    def kinetic(self) -> float:
        """Energy of the motion [J]."""

    def potential(self) -> float:
        """Energy of strains, weight and forces [J]."""

    def linearise(self, mass: Array, stiffness: Array) -> None:
        """Matrices of the small motions."""

    def tensions(self) -> tuple[float, ...]:
        """Tensions of the tendons [N]."""


def spread_mass(lengths: Array, mass_per_m: Array, radius: Array) -> tuple[Array, Array]:
    """``middles`` and ``ends`` of elements whose mass turns as discs of a radius [m] do.

    Args:
        lengths: of the elements [m].
        mass_per_m: of each element [kg/m].
        radius: of each element [m].
    """
    mass = lengths * mass_per_m
    turning = 0.25 * mass * radius**2
    both = np.stack((mass, turning), axis=1)
    ends = _END * both
    ends[:-1] += _END * both[1:]
    return _MIDDLE * both, ends


class MovingRod:
    """A rod that moves; one object is for one thread.

    Args:
        elements: its elements.
        stiffness: of the strains, ``(elements, 6)`` [N m]: bends and twist are in rad, the others ratios.
        damping_s: time by which stiffness becomes damping [s].

    Attributes:
        stiffness: the present one.
    """

    def __init__(self, elements: MovingElements, stiffness: Array, damping_s: float) -> None:
        self.elements, self.damping_s = elements, damping_s
        self.count = len(elements.lengths)
        self._kernel: MotionKernel = load("dynamics").Rod(elements)
        self.stiffen(stiffness)
        self.load()

    def stiffen(self, stiffness: Array) -> None:
        """Take another stiffness of the strains, as chambers under other pressures have it."""
        self.stiffness = np.ascontiguousarray(stiffness)
        self._kernel.stiffen(self.stiffness, self.damping_s)

    def load(
        self,
        *,
        gravity_m_s2: Vec3 = ZERO3,
        wrenches: dict[int, Sequence[float]] | None = None,
        strains: Array | None = None,
        pulls_m: Array | None = None,
        within_s: float = 0.0,
    ) -> None:
        """Set what acts from now on.

        Args:
            gravity_m_s2: acceleration, in the base frame.
            wrenches: dead force [N] and moment [N m], six numbers, on the ends of elements. Element 0 ends at
                node 1: numbers are one less than those of `run` and `poses`.
            strains: moments that work on the strains, such as those of chambers, ``(elements, 6)``.
            pulls_m: pulls of the tendons.
            within_s: time in which the tendons get there, evenly; one step at least.
        """
        self._nodes = np.zeros((self.count, 6))
        for node, wrench in (wrenches or {}).items():
            self._nodes[node] = wrench
        self._gravity = list(gravity_m_s2)
        self._strains = np.zeros((self.count, STRAINS)) if strains is None else np.ascontiguousarray(strains)
        self._pulls = (
            np.zeros(len(self.elements.tendon)) if pulls_m is None else np.ascontiguousarray(pulls_m)
        )
        self._kernel.load(self._gravity, self._nodes, self._strains, self._pulls, within_s)

    def put(self, strain: Array) -> None:
        """Be at rest with strains ``(elements, 6)``."""
        self._kernel.put(np.ascontiguousarray(strain))

    def settle(self) -> None:
        """Go to the equilibrium that Newton's method finds from here, at rest.

        Raises:
            ArithmeticError: none was found.
        """
        if not self._kernel.settle():
            raise ArithmeticError("no equilibrium of the moving rod found")

    def run(self, seconds: float, step_s: float, every: int = 1, nodes: Sequence[int] | None = None) -> Array:
        """Move on; poses after each ``every`` steps.

        Args:
            seconds: how long.
            step_s: length of a step.
            every: steps between two rows.
            nodes: which nodes, 0 is the base; the tip by default.

        Returns:
            Position [m] and rotation, rows one after the other: ``(rows, nodes, 12)``.

        Raises:
            ArithmeticError: a step had no answer, not in 64 parts either.
        """
        chosen = [self.count] if nodes is None else list(nodes)
        rows = round(seconds / step_s / every)
        poses = np.empty((rows, len(chosen), 12))
        if self._kernel.run(step_s, every, chosen, poses) < rows * every:
            raise ArithmeticError("the moving rod: a step has no answer")
        return poses

    @property
    def poses(self) -> Array:
        """Position [m] and rotation of every node, ``(elements + 1, 12)``."""
        out = np.empty((self.count + 1, 12))
        self._kernel.poses(out)
        return out

    @property
    def strain(self) -> Array:
        """Strains ``(elements, 6)``."""
        strain, momentum = np.empty((self.count, STRAINS)), np.empty(self._kernel.free)
        self._kernel.state(strain, momentum)
        return strain

    @property
    def energy_j(self) -> float:
        """Energy of motion, strains, weight and forces together."""
        return self._kernel.kinetic() + self._kernel.potential()

    @property
    def tensions_n(self) -> Array:
        """Tensions of the tendons half-way in the last step, with their damping."""
        return np.array(self._kernel.tensions())

    def modes(self) -> Modes:
        """Small motions about the present strains, which should be an equilibrium.

        With damping D = c K a mode of unit mass and rate w has the ratio ``c shape^T K shape / 2 w``, where K
        is the stiffness of strains and tendons alone: weight stiffens or softens a mode and does not damp it.
        """
        mass, stiffness = self._linearised()
        root = np.linalg.cholesky(mass)
        whitened = np.linalg.solve(root, np.linalg.solve(root, stiffness).T)
        squares, turned = np.linalg.eigh(whitened)
        shapes = np.linalg.solve(root.T, turned)
        rates = np.sqrt(np.maximum(squares, 0.0))
        self._kernel.load([0.0, 0.0, 0.0], np.zeros_like(self._nodes), self._strains, self._pulls, 0.0)
        own = self._linearised()[1]
        self._kernel.load(self._gravity, self._nodes, self._strains, self._pulls, 0.0)
        damped = self.damping_s * np.einsum("ik,ij,jk->k", shapes, own, shapes)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(rates > 0.0, 0.5 * damped / rates, np.inf)
        return Modes(rates / (2.0 * np.pi), ratio, shapes.T)

    def _linearised(self) -> tuple[Array, Array]:
        """Mass and stiffness of small motions; moments that keep their direction leave a skew part out."""
        free = self._kernel.free
        mass, stiffness = np.empty((free, free)), np.empty((free, free))
        self._kernel.linearise(mass, stiffness)
        return mass, 0.5 * (stiffness + stiffness.T)
