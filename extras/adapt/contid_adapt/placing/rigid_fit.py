"""The rigid motion between points that are known in two frames.

W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32, 1976.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


class RigidFit(NamedTuple):
    """The motion ``p -> at + turn (p - origin)``.

    Attributes:
        turn: a rotation, never a mirror, shape ``(3, 3)``.
        origin: mean of the points in their own frame, shape ``(3,)``, in their unit.
        at: where it lies in the world, shape ``(3,)``, in the same unit.
        rms: root mean square of the distances after the motion, in the same unit.
    """

    turn: Floats
    origin: Floats
    at: Floats
    rms: float


def rigid_fit(own: Floats, world: Floats) -> RigidFit | None:
    """The motion with the least squares of the distances; None of points on a line.

    Args:
        own: points in their own frame, shape ``(n, 3)``.
        world: the same points in the world, shape ``(n, 3)``, in the same unit.
    """
    origin, at = own.mean(axis=0), world.mean(axis=0)
    u, sizes, vt = np.linalg.svd((world - at).T @ (own - origin))
    if sizes[1] < 1e-6 * max(sizes[0], 1e-12):
        return None
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    off = at + (own - origin) @ turn.T - world
    return RigidFit(turn, origin, at, float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))
