"""Cross products and rigid motions, for the derivatives that NumPy computes beside the kernel."""

from __future__ import annotations

from typing import NamedTuple

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


class RigidMotion(NamedTuple):
    """A motion ``x -> R x + p``.

    Attributes:
        R: rotation matrix, shape (3, 3).
        p: shift, shape (3,), in the unit of lengths.
    """

    R: Array
    p: Array


def exp_se3(u: Array, v: Array) -> RigidMotion:
    """Exponential of a twist: the motion of a frame with constant strains over a length of 1.

    K. M. Lynch, F. C. Park: "Modern Robotics", Cambridge University Press 2017, sections 3.2.3 and 3.3.3:
    ``R = I + a hat(u) + b hat(u)^2``, ``shift = (I + b hat(u) + c hat(u)^2) v`` with a = sin t / t,
    b = (1 - cos t) / t^2, c = (t - sin t) / t^3, by their series below t = 0.05, where the quotients lose
    digits (the remainder is then below 1e-17).

    Args:
        u: rotation vector [rad], shape (3,).
        v: translation part, in the unit of lengths, shape (3,); both in the frame that moves.
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
    return RigidMotion(eye + a * k + b * kk, (eye + b * k + c * kk) @ v)
