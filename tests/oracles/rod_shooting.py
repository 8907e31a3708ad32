"""Statics of a loaded rod by shooting: quaternions, DOP853, and pressures and loads raised together.

Independent of contid's integrator, unknowns and step control; it shares the section's constants, which the
golden rows of the reference check.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Rod, Section

#: Parts in which pressures and load grow; one that moves the tip by more of the reach than this is halved,
#: also one whose base moment is farther from its prediction than this part of force times reach: else the
#: solver finds an equilibrium on the other side of a fork.
RAMP_STEPS = 24
MOST_MOVED = 0.08
NEAR = 0.005
LEAST_STEP = 1e-6


Row = tuple[float, float, float]


def _rotation(w: float, x: float, y: float, z: float) -> tuple[Row, Row, Row]:
    """Rows of the rotation of a quaternion of any length, in numbers: numpy is slow with three entries."""
    two = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        (two * (x * y + w * z), 1 - two * (x * x + z * z), two * (y * z - w * x)),
        (two * (x * z - w * y), two * (y * z + w * x), 1 - two * (x * x + y * y)),
    )


def _section_end(
    section: Section, pressures: Array, state: Array, force: Array, weight: Array, link_weight: Array
) -> Array:
    """Integrate position, quaternion and moment through one section and its link.

    ``force`` [N] acts on the end of the link, ``weight`` [N] on the section, ``link_weight`` on its link.
    """
    modulus = section.modulus(float(pressures.mean()))[0]
    bend, axial = modulus * section.inertia, modulus * section.area
    twist, shear = modulus / 3.0 * section.torsion, axial / 3.0
    push_z = float(section.pair_force * pressures.sum())
    couple_x, couple_y, couple_z = (section.pair_moment @ pressures).tolist()
    behind = force + link_weight

    def rates(s: float, state: Array) -> tuple[float, ...]:
        fx, fy, fz = (behind + weight * (1.0 - s / section.length)).tolist()
        w, x, y, z, mx, my, mz = state[3:].tolist()
        (r11, r12, r13), (r21, r22, r23), (r31, r32, r33) = _rotation(w, x, y, z)
        ux = (r11 * mx + r21 * my + r31 * mz + couple_x) / bend
        uy = (r12 * mx + r22 * my + r32 * mz + couple_y) / bend
        uz = (r13 * mx + r23 * my + r33 * mz + couple_z) / twist
        vx = (r11 * fx + r21 * fy + r31 * fz) / shear
        vy = (r12 * fx + r22 * fy + r32 * fz) / shear
        vz = 1.0 + (r13 * fx + r23 * fy + r33 * fz + push_z) / axial
        px, py, pz = (
            r11 * vx + r12 * vy + r13 * vz,
            r21 * vx + r22 * vy + r23 * vz,
            r31 * vx + r32 * vy + r33 * vz,
        )
        dq = (
            -0.5 * (x * ux + y * uy + z * uz),
            0.5 * (w * ux + y * uz - z * uy),
            0.5 * (w * uy + z * ux - x * uz),
            0.5 * (w * uz + x * uy - y * ux),
        )
        return px, py, pz, *dq, py * -fz + pz * fy, pz * -fx + px * fz, px * -fy + py * fx

    end: Array = solve_ivp(rates, (0.0, section.length), state, method="DOP853", rtol=1e-9, atol=1e-9).y[
        :, -1
    ]
    arm = section.link * np.array([row[2] for row in _rotation(*end[3:7].tolist())])
    end[:3] += arm
    end[7:10] -= np.cross(arm, force + 0.5 * link_weight)
    return end


def shoot(
    rod: Rod,
    pressures: Array,
    force: Array,
    base_moment: Array,
    weights: Array | None = None,
    link_weights: Array | None = None,
) -> tuple[Array, Array]:
    """Tip [mm] and moment left at the tip [N·mm] for a base moment.

    ``weights`` and ``link_weights`` are those of every section and link, shape ``(sections, 3)`` [N].
    """
    state = np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], base_moment])
    none = np.zeros((len(rod.sections), 3))
    weights = none if weights is None else weights
    link_weights = none if link_weights is None else link_weights
    for i, section in enumerate(rod.sections):
        carried = force + weights[i + 1 :].sum(axis=0) + link_weights[i + 1 :].sum(axis=0)
        own = pressures[3 * i : 3 * i + 3]
        state = _section_end(section, own, state, carried, weights[i], link_weights[i])
    return state[:3], state[7:10]


def ramped_tip(rod: Rod, pressures: Array, force: Array, steps: int = RAMP_STEPS) -> Array | None:
    """Tip [mm] that is reached when pressures and force grow together; None where a step does not follow."""
    moment, before = np.zeros(3), np.zeros(3)
    tip = np.array([0.0, 0.0, rod.reach])
    done, behind, step = 0.0, 0.0, 1.0 / steps
    while done < 1.0:
        part = min(1.0, done + step)

        def unbalanced(m: Array, part: float = part) -> Array:
            return shoot(rod, part * pressures, part * force, m)[1]

        slope = (moment - before) / (done - behind) if done > 0.0 else np.zeros(3)
        predicted = moment + (part - done) * slope
        found = root(unbalanced, predicted, options={"xtol": 1e-9})
        reached = shoot(rod, part * pressures, part * force, found.x)[0]
        near = np.linalg.norm(found.x - predicted) < NEAR * np.linalg.norm(force) * rod.reach
        if found.success and near and np.linalg.norm(reached - tip) < MOST_MOVED * rod.reach:
            before, moment, behind, done, tip = moment, found.x, done, part, reached
            step = min(2.0 * step, 1.0 / steps)
        else:
            step *= 0.5
            if step < LEAST_STEP:
                return None
    return tip
