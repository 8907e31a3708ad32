"""A chain of elements of constant strain: positions, frames and the twists of its coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from contid.kinematics.array import Array


@dataclass(frozen=True, eq=False)
class ElementChain:
    """Elements in the base frame.

    Attributes:
        points: the start and the ends of the elements, rigid pieces included [m], ``(elements + 1, 3)``.
        rotations: frames there, ``(elements + 1, 3, 3)``.
        axes, shifts: of every coordinate, the axis about which and the shift by which everything beyond
            moves, about the origin of the base frame; ``(elements, 4, 3)``.
    """

    points: Array
    rotations: Array
    axes: Array
    shifts: Array


def chain_of(x: Array, h: Array, rigid: Array, base_m: float) -> ElementChain:
    """Positions of the nodes and the twists of the coordinates."""
    count = len(h)
    spin, local, bare, turn = local_twists(x, h)
    ends = bare + rigid[:, None] * turn[:, :, 2]
    points, rotations = np.empty((count + 1, 3)), np.empty((count + 1, 3, 3))
    points[0], rotations[0] = (0.0, 0.0, base_m), np.eye(3)
    for n in range(count):
        points[n + 1] = points[n] + rotations[n] @ ends[n]
        rotations[n + 1] = rotations[n] @ turn[n]
    axes = np.einsum("eij,ekj->eki", rotations[:-1], spin)
    shifts = np.einsum("eij,ekj->eki", rotations[:-1], local) + np.cross(points[:-1, None, :], axes)
    return ElementChain(points, rotations, axes, shifts)


def local_twists(x: Any, h: Array) -> tuple[Any, Any, Any, Any]:
    """Axes and shifts of the coordinates of every element, its end and its turn, in the frame of its start.

    Also of complex strains, for derivatives.
    """
    count = len(h)
    w = np.stack((-x[:, 1], x[:, 0], x[:, 2]), axis=1)
    t2 = np.sum(w * w, axis=1)
    a, b, c, db, dc = _series(t2)
    skew = _skew(w)
    square = skew @ skew
    turn = np.eye(3) + a[:, None, None] * skew + b[:, None, None] * square
    left = np.eye(3) + b[:, None, None] * skew + c[:, None, None] * square
    e3 = np.array([0.0, 0.0, 1.0])
    stretched = h * (1.0 + x[:, 3])
    across = np.cross(w, e3)
    twice = np.cross(w, across)
    chord = e3 + b[:, None] * across + c[:, None] * twice
    # Derivative of the chord by w: column n.
    by_w = np.empty((count, 3, 3), dtype=x.dtype)
    for n in range(3):
        unit = np.eye(3)[n]
        d_across = np.cross(unit, e3)
        d_twice = np.cross(unit, across) + np.cross(w, d_across)
        by_w[:, :, n] = (
            (2.0 * w[:, n] * db)[:, None] * across + b[:, None] * d_across
            + (2.0 * w[:, n] * dc)[:, None] * twice + c[:, None] * d_twice
        )  # fmt: skip
    # Coordinates (u, v, t, e): w = (-v, u, t).
    spin = np.stack(
        (left[:, :, 1], -left[:, :, 0], left[:, :, 2], np.zeros((count, 3), dtype=x.dtype)), axis=1
    )
    shift = np.stack(
        (
            stretched[:, None] * by_w[:, :, 1], -stretched[:, None] * by_w[:, :, 0],
            stretched[:, None] * by_w[:, :, 2], h[:, None] * chord,
        ),
        axis=1,
    )  # fmt: skip
    bare = stretched[:, None] * chord
    return spin, shift - np.cross(spin, bare[:, None, :]), bare, turn


def _series(t2: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Sin t / t, (1 - cos t) / t^2, (t - sin t) / t^3, and the derivatives of the last two by t^2."""
    terms = range(12)
    fact = [float(math.factorial(n)) for n in range(30)]
    powers = np.stack([t2**n for n in terms])
    signs = np.array([(-1.0) ** n for n in terms])

    def of(offset: int) -> Array:
        value: Array = (signs / [fact[2 * n + offset] for n in terms]) @ powers
        return value

    def slope(offset: int) -> Array:
        weights = [(-1.0) ** n * n / fact[2 * n + offset] for n in terms[1:]]
        value: Array = np.array(weights) @ powers[:-1]
        return value

    return of(1), of(2), of(3), slope(2), slope(3)


def _skew(w: Array) -> Array:
    zero = np.zeros(len(w), dtype=w.dtype)
    rows = ((zero, -w[:, 2], w[:, 1]), (w[:, 2], zero, -w[:, 0]), (-w[:, 1], w[:, 0], zero))
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
