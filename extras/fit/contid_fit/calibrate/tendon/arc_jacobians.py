"""Derivatives of an arc of constant curvature; `contid.kinematics.arc.arc` has its equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from contid.kinematics.arc.arc import coefficients
from contid.kinematics.array import Array


class ArcJacobians(NamedTuple):
    """Columns by u, v and L: of the position and of the spatial angular velocity, both ``(..., 3, 3)``."""

    position: Array
    angular: Array


def jacobians(u: Array, v: Array, L: Array) -> ArcJacobians:
    """Derivatives of the end of an arc by u, v [rad] and L [m].

    The angular columns are ``Jl(w) dw`` with the left Jacobian ``Jl = I + B [w]x + C [w]x^2``.
    """
    u, v, L = np.broadcast_arrays(u, v, L)
    c = coefficients(u * u + v * v)
    linear = np.empty((*u.shape, 3, 3))
    linear[..., 0, 0] = L * (c.B + u * u * c.B1)
    linear[..., 0, 1] = linear[..., 1, 0] = L * u * v * c.B1
    linear[..., 1, 1] = L * (c.B + v * v * c.B1)
    linear[..., 2, 0], linear[..., 2, 1] = L * u * c.A1, L * v * c.A1
    linear[..., 0, 2], linear[..., 1, 2], linear[..., 2, 2] = u * c.B, v * c.B, c.A
    angular = np.zeros_like(linear)  # the column of L stays zero: the rotation does not depend on L
    angular[..., 0, 0] = -c.C * u * v
    angular[..., 1, 0] = 1.0 - c.C * v * v
    angular[..., 2, 0] = -c.B * v
    angular[..., 0, 1] = c.C * u * u - 1.0
    angular[..., 1, 1] = c.C * u * v
    angular[..., 2, 1] = c.B * u
    return ArcJacobians(linear, angular)
