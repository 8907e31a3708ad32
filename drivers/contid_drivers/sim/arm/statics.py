"""Statics of a simulated pneumatic arm by the literal equations (Shi et al., eqs. 1-11), in plain Python.

The errata of docs/robots/stiffflop.md are applied. Another formulation than `contid.kinematics.cosserat` on
purpose: wall force n and wall moment m are states, the six chambers push one by one, classical RK4 integrates
a rotation that it does not keep orthogonal, and the base moment is found by shooting with finite differences.
Twin and specification of ``contid.kernels._plant``, which is a thousand times faster.

Units: mm, N, N·mm, bar.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.kernels import load
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.geometry import SectionGeometry

Array: TypeAlias = NDArray[np.float64]
Numbers: TypeAlias = tuple[float, ...]

#: Steps of RK4 per section; halved, a tip moves by less than a micrometre.
STEPS: Final = 12
#: One bar on one mm^2 pushes with 0.1 N.
NEWTON_PER_BAR_MM2: Final = 0.1
#: Newton steps at most.
_NEWTON: Final = 20
#: Steps of the differences by the unknowns: base moment [N·mm] and push of the wall [N].
_STEP: Final = np.array([1e-6, 1e-6, 1e-6, 1e-7])
#: Sum of the moments left over at the tip [N·mm], and distance from the wall [mm], of an equilibrium.
_BALANCE: Final = 1e-9


#: Finds an equilibrium; arguments and result of `LiteralArm.solve`.
Solve: TypeAlias = Callable[
    [Sequence[float], Sequence[float], Sequence[float], bool, Sequence[float], float],
    tuple[Numbers, Numbers, bool],
]


def section_numbers(section: SectionGeometry, modulus_scale: float, moment_scale: float) -> Numbers:
    """Constants of a section: its six chambers summed one by one (eq. 5, with their projected distances).

    Length, link [mm], area [mm^2], inertia, torsion [mm^4], force of a pair [N/bar]; moments of the three
    pairs, x and y of each [N·mm/bar]; the five coefficients of the modulus [Pa]; end of its range [bar].
    """
    outer, inner, chamber = section.radius_mm, section.channel_radius_mm, section.chamber_radius_mm
    chamber_area = math.pi * chamber**2
    half = math.radians(section.pair_angle_deg) / 2.0
    area = math.pi * (outer**2 - inner**2)
    inertia = math.pi / 4.0 * (outer**4 - inner**4)
    push = 2.0 * chamber_area * NEWTON_PER_BAR_MM2
    turn: list[float] = []
    for k in range(3):
        pair = math.radians(section.first_pair_deg + 120.0 * k)
        moment = [0.0, 0.0]
        for azimuth in (pair - half, pair + half):
            x, y = (
                section.chamber_placement_mm * math.cos(azimuth),
                section.chamber_placement_mm * math.sin(azimuth),
            )
            area -= chamber_area
            inertia -= math.pi / 4.0 * chamber**4 + chamber_area * y * y
            moment[0] += chamber_area * NEWTON_PER_BAR_MM2 * y
            moment[1] -= chamber_area * NEWTON_PER_BAR_MM2 * x
        turn += [moment_scale * section.bending_gain * part for part in moment]
    modulus = [modulus_scale * b for b in section.modulus_pa]
    return (
        section.length_mm, section.link_mm, area, inertia, 2.0 * inertia, push, *turn, *modulus,
        section.modulus_up_to_bar,
    )  # fmt: skip


def arm_solver(robot: Cosserat) -> Solve:
    """The solver of an arm with the errors of its ``sim``: compiled where available."""
    assert robot.sim is not None
    errors, sections = robot.sim.errors, robot.geometry.sections
    moduli = (*errors.modulus_percent, *(0.0,) * len(sections))
    moment_scale = 1.0 + errors.moment_percent / 100.0
    rows = [
        section_numbers(section, 1.0 + percent / 100.0, moment_scale)
        for section, percent in zip(sections, moduli, strict=False)
    ]
    kernel = load("plant")
    if kernel is None:
        return LiteralArm(rows, STEPS).solve
    compiled: Solve = kernel.Arm(rows, STEPS).solve
    return compiled


class LiteralArm:
    """The specification; rows of `section_numbers`."""

    def __init__(self, sections: Sequence[Numbers], steps: int) -> None:
        self._sections = [np.array(row) for row in sections]
        self._steps = steps

    def solve(
        self,
        pressures: Sequence[float],
        force: Sequence[float],
        guess: Sequence[float],
        held: bool,
        normal: Sequence[float],
        offset: float,
    ) -> tuple[Numbers, Numbers, bool]:
        """Equilibrium of the arm from a guess nearby: tip [mm], unknowns, and whether it was found.

        The columns of the differences are integrated side by side.

        Args:
            pressures: that act [bar].
            force: dead, on the tip [N].
            guess: of the unknowns: base moment [N·mm] and push of the wall [N], four numbers.
            held: the tip is on the wall.
            normal: of the wall.
            offset: of the wall along its normal [mm].
        """
        load_n, out_of_wall = np.array(force), np.array(normal)
        count = 4 if held else 3
        x = np.array(guess, float)
        if not held:
            x[3] = 0.0
        tip = np.zeros(3)
        met = False
        for _ in range(_NEWTON):
            trials = np.vstack([x, x + np.diag(_STEP)[:count]])
            forces = load_n + trials[:, 3:] * out_of_wall
            tips, moments = self._shoot(np.array(pressures), forces, trials[:, :3])
            errors = np.column_stack([moments, tips @ out_of_wall - offset])[:, :count]
            tip = tips[0]
            met = bool(np.abs(moments[0]).sum() < _BALANCE and (not held or abs(errors[0, 3]) < _BALANCE))
            if met:
                break
            slopes = (errors[1:] - errors[0]).T / _STEP[:count]
            x[:count] -= np.linalg.solve(slopes, errors[0])
        return tuple(tip.tolist()), tuple(x.tolist()), met

    def _shoot(self, pressures: Array, force: Array, moment: Array) -> tuple[Array, Array]:
        """Tips and moments left over there, of rows of forces and base moments."""
        count = len(force)
        p, R, n, m = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), force, moment
        for i, row in enumerate(self._sections):
            length, link, area, inertia, torsion, per_bar = row[:6]
            own = pressures[3 * i : 3 * i + 3]
            x = min(max(float(own.sum()) / 3.0, 0.0), float(row[17]))
            modulus = 1e-6 * float(np.polyval(row[12:17], x))
            shift = area * np.array([modulus / 3.0, modulus / 3.0, modulus])
            bend = np.array([modulus * inertia, modulus * inertia, modulus / 3.0 * torsion])
            push = per_bar * float(own.sum())
            turn = np.append(own @ row[6:12].reshape(3, 2), 0.0)

            def rates(
                R: Array, n: Array, m: Array, shift: Array = shift, bend: Array = bend, push: float = push,
                turn: Array = turn,
            ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
                v = np.einsum("bji,bj->bi", R, n) / shift + [0.0, 0.0, 1.0]
                u = np.einsum("bji,bj->bi", R, m) / bend
                p_s = np.einsum("bij,bj->bi", R, v)
                hat_u = np.zeros((len(u), 3, 3))
                hat_u[:, 0, 1], hat_u[:, 0, 2], hat_u[:, 1, 2] = -u[:, 2], u[:, 1], -u[:, 0]
                R_s = R @ (hat_u - hat_u.transpose(0, 2, 1))
                side = push * np.stack([v[:, 1], -v[:, 0], 0.0 * v[:, 0]], axis=1)
                l_P = np.einsum("bij,bj->bi", R, side + np.cross(u, turn))
                return p_s, R_s, push * R_s[:, :, 2], l_P - np.cross(p_s, n)

            n, m = n + push * R[:, :, 2], m + R @ turn
            h = length / self._steps
            for _ in range(self._steps):
                a = rates(R, n, m)
                b = rates(R + 0.5 * h * a[1], n + 0.5 * h * a[2], m + 0.5 * h * a[3])
                c = rates(R + 0.5 * h * b[1], n + 0.5 * h * b[2], m + 0.5 * h * b[3])
                d = rates(R + h * c[1], n + h * c[2], m + h * c[3])
                p, R, n, m = (
                    old + h / 6.0 * (w + 2.0 * x_ + 2.0 * y + z)
                    for old, w, x_, y, z in zip((p, R, n, m), a, b, c, d, strict=True)
                )
            n, m = n - push * R[:, :, 2], m - R @ turn
            m = m - link * np.cross(R[:, :, 2], n)
            p = p + link * R[:, :, 2]
        return p, m
