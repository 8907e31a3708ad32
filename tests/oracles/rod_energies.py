"""Frequencies of a rod from its energies alone: exponentials of rigid motions, differences of energies.

Written apart from the kernel, in numpy: it shares the masses and stiffness of the elements with it, and no
derivation of twists, mass matrices or balances.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh

from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.units import STANDARD_GRAVITY
from contid_dynamics.arm import MovingArm
from contid_dynamics.rod import STRAINS, MovingElements

_STRAIN = 2e-4


def energy_frequencies(arm: MovingArm, actuation: Sequence[float]) -> Array:
    """Of the small motions of an arm that rests under an actuation [Hz], slowest first."""
    robot = arm.robot
    gravity = STANDARD_GRAVITY * np.array(robot.down_in_base) if robot.has_weight else np.zeros(3)
    loads, pulls = np.zeros((arm.rod.count, STRAINS)), np.array(actuation)
    if isinstance(robot, Cosserat):
        # Pressures shift the strains without stress: constant moments beside the present stiffness.
        loads, pulls = np.array(arm.rod._strains), np.zeros(0)
    elements, per = arm.rod.elements, arm.rod.elements.strains
    size = arm.rod.count * per
    rest = arm.rod.strain
    masses = np.concatenate((elements.middles[:, 0], elements.ends[:, 0]))
    turning = np.concatenate((elements.middles[:, 1], elements.ends[:, 1]))

    def bodies(free: Array) -> Array:
        """Positions and two directors of the bodies, each times the root of its mass, ``(rows, numbers)``."""
        at, frames = _bodies(_spread(rest, free, per), elements)
        parts = [np.sqrt(masses)[:, None] * at]
        parts += [np.sqrt(turning)[:, None] * frames[..., k] for k in (0, 1)]
        return np.concatenate([part.reshape(len(free), -1) for part in parts], axis=1)

    def energy(free: Array) -> Array:
        strain = _spread(rest, free, per)
        at, _ = _bodies(strain, elements)
        elastic = ((0.5 * arm.rod.stiffness * strain - loads) * strain).sum(axis=(1, 2))
        weight = -np.einsum("i,rij,j->r", masses, at, gravity)
        taut = np.maximum(0.0, elements.rest + elements.tendon * (pulls - _shortened(strain, elements)))
        springs = np.divide(0.5 * taut**2, elements.tendon).sum(axis=1) if len(pulls) else 0.0
        return np.asarray(elastic + weight + springs)

    steps = _STRAIN * np.eye(size)
    moved = (bodies(steps) - bodies(-steps)) / (2.0 * _STRAIN)
    first, second = np.triu_indices(size)
    pairs = [energy(a * steps[first] + b * steps[second]) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    hessian = np.zeros((size, size))
    hessian[first, second] = (pairs[0] - pairs[1] - pairs[2] + pairs[3]) / (4.0 * _STRAIN**2)
    hessian = np.where(hessian == 0.0, hessian.T, hessian)
    squares = eigh(hessian, moved @ moved.T, eigvals_only=True)
    return np.asarray(np.sqrt(squares) / (2.0 * np.pi))


def _spread(rest: Array, free: Array, per: int) -> Array:
    out = np.zeros((len(free), len(rest), STRAINS))
    out[..., :per] = free.reshape(len(free), -1, per)
    return out + rest


def _bodies(strain: Array, elements: MovingElements) -> tuple[Array, Array]:
    """Middles, then ends of all elements: positions ``(rows, bodies, 3)`` and rotations."""
    rows, count, _ = strain.shape
    at, frame = np.tile([0.0, 0.0, elements.base_m], (rows, 1)), np.tile(np.eye(3), (rows, 1, 1))
    middles: list[tuple[Array, Array]] = []
    ends: list[tuple[Array, Array]] = []
    for e in range(count):
        u, v, t, stretch, a, b = np.moveaxis(strain[:, e], 1, 0)
        for found in (middles, ends):
            turn, shift = _moved(
                0.5 * np.stack((-v, u, t), axis=1),
                0.5 * elements.lengths[e] * np.stack((a, b, 1.0 + stretch), axis=1),
            )
            at = at + np.einsum("rij,rj->ri", frame, shift)
            frame = frame @ turn
            if found is ends:
                at = at + elements.rigid[e] * frame[:, :, 2]
            found.append((at, frame))
    both = middles + ends
    return np.stack([each[0] for each in both], axis=1), np.stack([each[1] for each in both], axis=1)


def _moved(turn: Array, shift: Array) -> tuple[Array, Array]:
    """The exponential of a rigid motion, by 12 terms of its series."""
    twist = np.zeros((len(turn), 4, 4))
    x, y, z = turn.T
    twist[:, 0, 1], twist[:, 0, 2], twist[:, 1, 2] = -z, y, -x
    twist[:, 1, 0], twist[:, 2, 0], twist[:, 2, 1] = z, -y, x
    twist[:, :3, 3] = shift
    out = term = np.tile(np.eye(4), (len(turn), 1, 1))
    for k in range(1, 13):
        term = term @ twist / k
        out = out + term
    return out[:, :3, :3], out[:, :3, 3]


def _shortened(strain: Array, elements: MovingElements) -> Array:
    """How much shorter the ways of tendons are than in the straight rod [m], ``(rows, tendons)``.

    In an element a tendon keeps its place in the cross-section: its speed along the backbone is constant.
    """
    h = elements.lengths[:, None]
    u, v, t, stretch, a, b = np.moveaxis(strain[..., None, :], -1, 0)
    x, y = elements.arms[..., 0], elements.arms[..., 1]
    speed = np.stack((a * h - t * y, b * h + t * x, (1.0 + stretch) * h - u * x - v * y), axis=-1)
    return np.asarray(np.nansum(h - np.linalg.norm(speed, axis=-1), axis=1))
