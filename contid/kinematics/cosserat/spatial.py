"""Vectors and screws, for the derivatives that NumPy computes beside the kernel."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array


def hat(a: Array) -> Array:
    """The matrix of ``a x``, shape (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, shape (3,); several times faster than `numpy.cross` for one pair."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
    )


def exponential(u: Array, v: Array) -> tuple[Array, Array]:
    """Rotation and shift of the screw motion ``exp(u, v)``: rotation vector u, translation part v.

    ``R = I + a hat(u) + b hat(u)^2``, ``shift = (I + b hat(u) + c hat(u)^2) v`` with a = sin t / t,
    b = (1 - cos t) / t^2, c = (t - sin t) / t^3, by their series below t = 0.05, where the quotients lose
    digits (the remainder is then below 1e-17).
    """
    t2 = float(u @ u)
    if t2 < 2.5e-3:
        a = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0)))
        b = 0.5 * (1.0 - t2 / 12.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0 * (1.0 - t2 / 90.0))))
        c = (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0 * (1.0 - t2 / 110.0)))) / 6.0
    else:
        t = float(np.sqrt(t2))
        a = float(np.sin(t)) / t
        b = (1.0 - float(np.cos(t))) / t2
        c = (1.0 - a) / t2
    k = hat(u)
    kk = k @ k
    eye = np.eye(3)
    return eye + a * k + b * kk, (eye + b * k + c * kk) @ v
