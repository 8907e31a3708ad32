"""Quaternions whose square is a tangent: the algebra under Pythagorean-hodograph curves.

A spatial Pythagorean hodograph is ``r'(t) = A(t) i A*(t)`` with a quaternion polynomial ``A``; written out
with ``A = u + v i + p j + q k`` that is Eqs. 8-11 of Singh et al. (IROS 2018), which are printed correctly.
The quaternion is the preimage of the vector, determined up to a turn ``A (cos phi + i sin phi)``.

A quaternion is an array ``(..., 4)`` in the order scalar, i, j, k; a vector is an array ``(..., 3)``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Below this the two quaternions (of unit length) have no preferred relative turn.
NO_TURN: Final = 1e-12
#: Closer to -i than this the square underflows.
UNDERFLOW: Final = 1e-150


def product(a: Array, b: Array) -> Array:
    """The symmetric product ``<A, B> = (A i B* + B i A*) / 2``, a vector; ``<A, A>`` is the hodograph.

    Args:
        a: quaternions, shape ``(..., 4)``.
        b: quaternions, shape ``(..., 4)``.

    Returns:
        Vectors, shape ``(..., 3)``.
    """
    a0, a1, a2, a3 = np.moveaxis(a, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            a0 * b0 + a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b3 + a3 * b0 + a1 * b2 + a2 * b1,
            a1 * b3 + a3 * b1 - a0 * b2 - a2 * b0,
        ],
        axis=-1,
    )


def times_i(a: Array) -> Array:
    """``A i``: the preimage a quarter turn on, of the same vector, shape ``(..., 4)``."""
    return np.stack([-a[..., 1], a[..., 0], a[..., 3], -a[..., 2]], axis=-1)


def turned(a: Array, cosine: float, sine: float) -> Array:
    """``A (cos phi + i sin phi)``: another preimage of the same vector."""
    return a * cosine + times_i(a) * sine


def lift(vector: Array) -> Array:
    """One preimage ``A`` of a vector, so that ``A i A* = vector``: ``sqrt|d| (i + n) / |i + n|``.

    Near ``n = -i`` the sum ``1 + n_x`` cancels and is taken as ``(n_y^2 + n_z^2) / (1 - n_x)``; at ``-i``
    itself the preimage is ``j``.
    """
    size = math.sqrt(float(vector @ vector))
    if size == 0.0:
        return np.zeros(4)
    x, y, z = (vector / size).tolist()
    off = math.hypot(y, z)
    if x < 0.0 and off < UNDERFLOW:
        return math.sqrt(size) * np.array([0.0, 0.0, 1.0, 0.0])
    one_plus_x = 1.0 + x if x > 0.0 else off * (off / (1.0 - x))
    norm = math.hypot(one_plus_x, off)
    return math.sqrt(size) / norm * np.array([0.0, one_plus_x, y, z])


def nearest(b: Array, a: Array, hint: Array) -> Array:
    """The preimage ``b`` turned to be nearest to ``a``: it maximises ``a . b``.

    Where every turn is equally near (opposite tangents: a half circle), the turn points ``<a, b>``, the
    tangent half-way, along ``hint``. Both choices are rotation-equivariant.
    """
    cosine, sine = float(b @ a), float(times_i(b) @ a)
    size = math.hypot(cosine, sine)
    if size <= NO_TURN * math.sqrt(float((a @ a) * (b @ b))):
        cosine, sine = float(product(a, b) @ hint), float(product(a, times_i(b)) @ hint)
        size = math.hypot(cosine, sine)
        if size == 0.0:
            return b
    return turned(b, cosine / size, sine / size)
