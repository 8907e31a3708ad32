"""The arc of constant curvature without torsion: position and rotation.

State of one section: ``(u, v, L)`` with the bending vector ``(u, v) = theta (cos phi, sin phi)`` [rad] and
the length of the backbone ``L`` [m]. With ``q = u^2 + v^2``, ``A = sin(theta)/theta``,
``B = (1 - cos theta)/theta^2``, ``C = (1 - A)/q``:

    P = L (u B, v B, A)
    R = [[1 - u^2 B, -u v B, u A], [-u v B, 1 - v^2 B, v A], [-u A, -v A, 1 - q B]] = exp([w]x)
    w = (-v, u, 0)

No radius and no azimuth is formed, so the straight arm is no singularity. Vectorised over leading dimensions.
``contid/kernels/arc/arc.hpp`` has the same formulas.

Sources: I. Singh et al., "Performances Evaluation of Inverse Kinematic Models of a Compact Bionic Handling
Assistant", ROBIO 2017, Eq. 2-5 (errata: ``atan`` for ``atan2`` in Eq. 2; R31 of Eq. 3 lacks its minus sign;
the root D of Eq. 2, of which theta = D / 3d, loses its digits by cancellation near the straight arm), and
J. Hughes, C. Della Santina, D. Rus, "Extensible High Force Manipulator for Complex Exploration", Eq. 2-3.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array

# Ten terms below this q leave a relative error of 1e-14 on both sides of the switch.
SERIES_BELOW: Final = 0.5
_TERMS: Final = 10


def _series_table() -> Array:
    """Coefficients of q^0..q^9 for A, B, C, 2 dA/dq, 2 dB/dq, shape (10, 5)."""
    table = np.zeros((_TERMS, 5))
    for k in range(_TERMS):
        for column, offset in enumerate((1, 2, 3)):
            table[k, column] = (-1.0) ** k / math.factorial(2 * k + offset)
        for column, offset in ((3, 3), (4, 4)):
            table[k, column] = -2.0 * (k + 1) * (-1.0) ** k / math.factorial(2 * k + offset)
    return table


_SERIES: Final = _series_table()
_POWERS: Final = np.arange(_TERMS)


class Coefficients(NamedTuple):
    """``A, B, C`` of the module and ``A1 = 2 dA/dq``, ``B1 = 2 dB/dq``, each of the shape of q.

    With the factor 2, ``dA/du = u A1`` and ``dA/dv = v A1``, because ``dq/du = 2 u``; B alike.
    """

    A: Array
    B: Array
    C: Array
    A1: Array
    B1: Array


def coefficients(q: Array) -> Coefficients:
    """The five even functions of the bending angle, from ``q = theta^2``: series below 0.5, closed above."""
    q = np.asarray(q, dtype=np.float64)
    small = q < SERIES_BELOW
    series = (np.where(small, q, 0.0)[..., None] ** _POWERS) @ _SERIES
    if small.all():
        return Coefficients(*np.moveaxis(series, -1, 0))
    large = np.where(small, 1.0, q)
    theta = np.sqrt(large)
    A = np.sin(theta) / theta
    B = 2.0 * np.sin(0.5 * theta) ** 2 / large
    closed = (A, B, (1.0 - A) / large, (np.cos(theta) - A) / large, (A - 2.0 * B) / large)
    return Coefficients(*(np.where(small, series[..., i], value) for i, value in enumerate(closed)))


class ArcEnd(NamedTuple):
    """Position ``(..., 3)`` [m] and rotation ``(..., 3, 3)`` of an end, in the frame of the start."""

    position: Array
    rotation: Array


def pose(u: Array, v: Array, L: Array) -> ArcEnd:
    """The end of an arc that starts at the origin along +z; u, v [rad] and L [m] have one shape."""
    u, v, L = np.broadcast_arrays(u, v, L)
    c = coefficients(u * u + v * v)
    position = np.stack((L * u * c.B, L * v * c.B, L * c.A), axis=-1)
    rotation = np.empty((*u.shape, 3, 3))
    rotation[..., 0, 0] = 1.0 - u * u * c.B
    rotation[..., 0, 1] = rotation[..., 1, 0] = -u * v * c.B
    rotation[..., 1, 1] = 1.0 - v * v * c.B
    rotation[..., 0, 2], rotation[..., 1, 2] = u * c.A, v * c.A
    rotation[..., 2, 0], rotation[..., 2, 1] = -u * c.A, -v * c.A
    rotation[..., 2, 2] = 1.0 - (u * u + v * v) * c.B
    return ArcEnd(position, rotation)
