"""Chains of constant curvature as products of matrix exponentials, and what an optimum on limits must fulfil.

The exponentials are scipy's and take complex numbers, so that derivatives by complex steps are exact. Nothing
here shares a formula with the kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

#: Lengths of tubes, or bends times lengths of sections, as arcs (u, v, L), shape ``(n, 3)``.
Arcs = Callable[[np.ndarray], np.ndarray]


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
        """Where the chain ends."""
        frame = np.eye(4, dtype=complex)
        mid = np.zeros(3)
        arcs = self.arcs(variables)
        twists = np.zeros((len(arcs), 4, 4), dtype=arcs.dtype)
        twists[:, :2, 2], twists[:, 2, :2], twists[:, 2, 3] = arcs[:, :2], -arcs[:, :2], arcs[:, 2]
        ahead = np.eye(4)
        for k, (turned, rigid) in enumerate(zip(expm(twists), self.rigid_m, strict=True)):
            ahead[2, 3] = rigid
            frame = frame @ turned @ ahead
            mid = frame[:3, 3] if k == 0 else mid
        tip = frame[:3, 3] + frame[:3, :2] @ np.array(self.offset_m)
        if np.iscomplexobj(variables):
            return Placed(tip, frame[:3, :3], mid)
        return Placed(tip.real, frame[:3, :3].real, mid.real)

    def jacobians(self, variables: np.ndarray) -> Placed:
        """Derivatives of tip and mid, and in place of the frame the spatial angular velocity, ``(3, N)``."""
        here, columns = self.placed(variables), []
        for k in range(len(variables)):
            step = np.zeros(len(variables), complex)
            step[k] = 1e-30j
            moved = self.placed(variables + step)
            spin = moved.rotation.imag / 1e-30 @ here.rotation.T
            turn = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            columns.append((moved.tip.imag / 1e-30, turn, moved.mid.imag / 1e-30))
        return Placed(*(np.stack(each, axis=1) for each in zip(*columns, strict=True)))


def of_tubes(sections: Any) -> Chain:
    """Tubes at ``d (cos a, sin a)``: their lengths are ``L - d (u cos a + v sin a)``."""
    rows = [
        np.array([[-d * np.cos(a), -d * np.sin(a), 1.0] for a in angles])
        for d, angles in zip(sections.radius_m, sections.angles_rad, strict=True)
    ]

    def arcs(lengths: np.ndarray) -> np.ndarray:
        each = np.reshape(lengths, (-1, 3))
        return np.array([np.linalg.solve(row, l) for row, l in zip(rows, each, strict=True)])

    return Chain(arcs, sections.rigid_m)


def of_bends(sections: Any) -> Chain:
    """Sections of given length whose variables are bends times that length."""
    length = np.array(sections.backbone_m)[:, None]

    def arcs(variables: np.ndarray) -> np.ndarray:
        return np.concatenate((np.reshape(variables, (-1, 2)) / length, length), axis=1)

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
