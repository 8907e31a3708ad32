"""Stability of a loaded rod by the second variation of its energy, as a matrix.

With dead loads the force N(s) is known, and the strains of stretch and shear follow from it. What is left is
an energy of the frames R(s) alone,

    E = sum over elements  h [ (u - u0) K (u - u0) / 2  -  (R' N) v0  -  (R' N) S (R' N) / 2 ],

u the rotation between two frames, R and N in the middle, K and S stiffness and compliance; a link adds
-l N R e3. Frames are varied as R exp(hat(t)). An equilibrium has no gradient, a stable one a positive
definite Hessian. Own discretisation, and no conjugate points: nothing of the kernel's count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Loads, Rod, Section
from tests.oracles.rod_equations import integrate

#: Elements of a section, and the step of differences.
ELEMENTS, STEP = 16, 1e-3


@dataclass(frozen=True)
class Variation:
    """Gradient (n,) and Hessian (n, n) of the energy [N·mm] by turns of the frames, the base's left out."""

    gradient: Array
    hessian: Array

    @property
    def unstable(self) -> int:
        """Number of directions in which the energy has no minimum."""
        return int(np.count_nonzero(np.linalg.eigvalsh(self.hessian) < 0.0))


@dataclass(frozen=True)
class _Element:
    """Elements of one section at its pressures: length [mm], K, S, reference curvature u0 and stretch v0."""

    length: float
    stiffness: Array
    compliance: Array
    curvature: Array
    stretch: Array

    @classmethod
    def of(cls, section: Section, pressures: Array) -> _Element:
        modulus = section.modulus(float(np.mean(pressures)))[0]
        shear = modulus / (2.0 * (1.0 + section.poisson))
        bending = np.array([modulus * section.inertia, modulus * section.inertia, shear * section.torsion])
        axial = modulus * section.area
        push = section.pair_force * float(np.sum(pressures))
        return cls(
            section.length / ELEMENTS,
            bending,
            1.0 / np.array([shear * section.area, shear * section.area, axial]),
            (section.pair_moment @ pressures) / bending,
            np.array([0.0, 0.0, 1.0 + push / axial]),
        )

    def energy(self, left: Rotation, right: Rotation, force: Array, turns: Array) -> Array:
        """Energies (n,) of elements between frames, those turned by (3,) and (3,)."""
        a, b = left * Rotation.from_rotvec(turns[:3]), right * Rotation.from_rotvec(turns[3:])
        between = (a.inv() * b).as_rotvec()
        half = a * Rotation.from_rotvec(0.5 * between)
        u, n = between / self.length - self.curvature, half.inv().apply(force)
        bent = 0.5 * (u * u) @ self.stiffness
        found: Array = self.length * (bent - n @ self.stretch - 0.5 * (n * n) @ self.compliance)
        return found


def variation(rod: Rod, pressures: Array, loads: Loads, base_moment: Array) -> Variation:
    """Of the rod that has a base moment [N·mm]; weights and a force on the tip, no moments, no joints."""
    zero = np.zeros(3)
    starts, stations = _stations(rod)
    frames = integrate(rod, pressures, loads, base_moment, stations).frames[:, 3:].reshape(-1, 3, 3)
    N = loads.tip_force + sum(
        section.length * loads.weight.get(i, zero) + section.link * loads.link_weight.get(i, zero)
        for i, section in enumerate(rod.sections)
    )
    nodes = ELEMENTS * len(rod.sections) + 1
    gradient, hessian = np.zeros(3 * nodes), np.zeros((3 * nodes, 3 * nodes))
    for i, section in enumerate(rod.sections):
        weight, link_weight = loads.weight.get(i, zero), loads.link_weight.get(i, zero)
        element = _Element.of(section, pressures[3 * i : 3 * i + 3])
        middle = N - np.outer((np.arange(ELEMENTS) + 0.5) * element.length, weight)
        left = Rotation.from_matrix(frames[starts[i] : starts[i] + ELEMENTS])
        right = Rotation.from_matrix(frames[starts[i] + 1 : starts[i] + ELEMENTS + 1])
        slopes, curvatures = _derivatives(partial(element.energy, left, right, middle))
        for k in range(ELEMENTS):
            at = 3 * (i * ELEMENTS + k)
            gradient[at : at + 6] += slopes[k]
            hessian[at : at + 6, at : at + 6] += curvatures[k]
        N = N - section.length * weight
        if section.link > 0.0:
            # Of -l n3 with n = R' N: under a turn t its second derivative is that of n . exp(hat(t)) e3.
            n = frames[starts[i] + ELEMENTS].T @ (N - 0.5 * section.link * link_weight)
            at = 3 * (i + 1) * ELEMENTS
            gradient[at : at + 3] += section.link * np.array([n[1], -n[0], 0.0])
            second = np.diag([n[2], n[2], 0.0])
            second[0, 2] = second[2, 0] = -0.5 * n[0]
            second[1, 2] = second[2, 1] = -0.5 * n[1]
            hessian[at : at + 3, at : at + 3] += section.link * second
            N = N - section.link * link_weight
    return Variation(gradient[3:], hessian[3:, 3:])


def _stations(rod: Rod) -> tuple[list[int], Array]:
    """Index of each section's first node, and arc lengths [mm] of the nodes, both ends of every section."""
    begin = 0.0
    found: list[float] = []
    starts: list[int] = []
    for section in rod.sections:
        starts.append(len(found))
        found += (begin + section.length * np.arange(ELEMENTS + 1) / ELEMENTS).tolist()
        begin += section.length + section.link
    return starts, np.array(found)


def _derivatives(energy: Callable[[Array], Array]) -> tuple[Array, Array]:
    """First and second central differences by six turns of the energies of n elements, (n, 6), (n, 6, 6)."""
    unit = STEP * np.eye(6)
    slopes = np.stack([(energy(d) - energy(-d)) / (2.0 * STEP) for d in unit], axis=1)
    rows = [[energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b) for b in unit] for a in unit]
    return slopes, np.moveaxis(np.array(rows), 2, 0) / (4.0 * STEP**2)
