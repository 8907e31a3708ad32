"""Chains of constant curvature as products of matrix exponentials, and what an optimum on limits must fulfil.

The exponentials are series. They take complex numbers, so that derivatives by complex steps are exact, and
rows, so that the steps are computed side by side. Nothing here shares a formula with the kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

#: Lengths of tubes, or bends times lengths of sections, as arcs (u, v, L), shape ``(n, 3)``.
Arcs = Callable[[np.ndarray], np.ndarray]


def exponential(matrices: np.ndarray) -> np.ndarray:
    """``sum M^k / k!`` of matrices ``(..., 4, 4)``, of a 32nd or less of each, squared as often."""
    largest = float(np.abs(matrices).max(initial=0.0))
    halvings = max(5, math.ceil(math.log2(max(largest, 1.0))) + 4)
    part = matrices / 2.0**halvings
    term = np.broadcast_to(np.eye(4), part.shape)
    total = term.astype(part.dtype)
    for k in range(1, 14):  # turns are 0.06 at most here: 1e-17 is left
        term = term @ part / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


class Placed(NamedTuple):
    """Tip [m], its frame, and the end of the first section [m]."""

    tip: np.ndarray
    rotation: np.ndarray
    mid: np.ndarray


class Chain(NamedTuple):
    """A chain of arcs with rigid pieces, and how its variables make arcs."""

    arcs: Arcs
    rigid_m: tuple[float, ...]
    offset_m: tuple[float, float] = (0.0, 0.0)

    def placed(self, variables: Any) -> Placed:
        """Where the chain ends; of each row of variables."""
        arcs = self.arcs(np.asarray(variables))
        twists = np.zeros((*arcs.shape[:-1], 4, 4), dtype=arcs.dtype)
        twists[..., :2, 2], twists[..., 2, :2], twists[..., 2, 3] = (
            arcs[..., :2],
            -arcs[..., :2],
            arcs[..., 2],
        )
        turned = exponential(twists)
        frame, mid = np.eye(4), np.zeros(3)
        for k, rigid in enumerate(self.rigid_m):
            ahead = np.eye(4)
            ahead[2, 3] = rigid
            frame = frame @ turned[..., k, :, :] @ ahead
            mid = frame[..., :3, 3] if k == 0 else mid
        tip = frame[..., :3, 3] + frame[..., :3, :2] @ np.array(self.offset_m)
        return Placed(tip, frame[..., :3, :3], mid)

    def jacobians(self, variables: np.ndarray) -> Placed:
        """Derivatives of tip and mid, and in place of the frame the spatial angular velocity, ``(3, N)``."""
        here, moved = self.placed(variables), self.placed(variables + 1e-30j * np.eye(len(variables)))
        spin = moved.rotation.imag / 1e-30 @ here.rotation.T
        turn = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]))
        return Placed(moved.tip.imag.T / 1e-30, turn, moved.mid.imag.T / 1e-30)


def of_tubes(sections: Any) -> Chain:
    """Tubes at ``d (cos a, sin a)``: their lengths are ``L - d (u cos a + v sin a)``."""
    d, a = np.array(sections.radius_m)[:, None], np.array(sections.angles_rad)
    rows = np.stack((-d * np.cos(a), -d * np.sin(a), np.ones_like(a)), axis=-1)

    def arcs(lengths: np.ndarray) -> np.ndarray:
        each = lengths.reshape(*lengths.shape[:-1], -1, 3, 1)
        return np.asarray(np.linalg.solve(np.broadcast_to(rows, (*each.shape[:-2], 3, 3)), each)[..., 0])

    return Chain(arcs, sections.rigid_m)


def of_bends(sections: Any) -> Chain:
    """Sections of given length whose variables are bends times that length."""
    length = np.array(sections.backbone_m)[:, None]

    def arcs(variables: np.ndarray) -> np.ndarray:
        bends = variables.reshape(*variables.shape[:-1], -1, 2) / length
        return np.concatenate((bends, np.broadcast_to(length, (*bends.shape[:-1], 1))), axis=-1)

    return Chain(arcs, sections.rigid_m, sections.offset_m)


def task(
    chain: Chain,
    ell_m: float,
    variables: np.ndarray,
    tip: Any,
    direction: Any = None,
    mid: Any = None,
    rotation: Any = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What is left to the target [m], and the derivative of where the chain is, by its variables."""
    at, by = chain.placed(variables), chain.jacobians(variables)
    errors, rows = [np.array(tip) - at.tip], [by.tip]
    if direction is not None:
        tangent = at.rotation[:, 2]
        errors.append(ell_m * (np.array(direction) - tangent))
        rows.append(ell_m * np.cross(by.rotation, tangent[:, None], axis=0))
    if rotation is not None:
        left = Rotation.from_matrix(np.reshape(rotation, (3, 3)) @ at.rotation.T)
        errors.append(ell_m * left.as_rotvec())
        rows.append(ell_m * by.rotation)
    if mid is not None:
        errors.append(np.array(mid) - at.mid)
        rows.append(by.mid)
    return np.concatenate(errors), np.vstack(rows)


def multipliers_left(gradient: np.ndarray, equations: np.ndarray, binding: np.ndarray) -> float:
    """Norm that stays of ``gradient + J^T y + N^T mu`` with the best y of any sign and mu of none below 0.

    It is 0 where the first-order conditions of Karush, Kuhn and Tucker hold: rows of ``equations`` are
    derivatives of equations, rows of ``binding`` outward normals of the limits that bind.
    """
    normals = [
        each / max(float(np.linalg.norm(each)), 1e-300) for each in (*equations, *-equations, *binding)
    ]
    if not normals:
        return float(np.linalg.norm(gradient))
    return float(nnls(np.stack(normals, axis=1), -gradient, maxiter=1000)[1])
