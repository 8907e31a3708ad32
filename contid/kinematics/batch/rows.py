"""Rows of a batch: targets in, poses and solutions out, each a structured array."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contid.kinematics.any_target import FAR_M
from contid.kinematics.array import Array

#: A structured array, shape ``(rows,)``.
Table: TypeAlias = NDArray[np.void]

#: One row of forward kinematics, each field as in `contid.targets.Pose`; the kernels write this layout.
POSE = np.dtype(
    [
        ("tip_m", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("direction", np.float64, (3,)),
        ("mid_m", np.float64, (3,)),
        ("stable", np.bool_),
    ],
    align=True,
)


def solution_dtype(axes: int) -> np.dtype[Any]:
    """One row of `Solutions` for a model with ``axes`` axes; the kernels write this layout."""
    return np.dtype(
        [
            ("actuation", np.float64, (axes,)),
            ("residual_m", np.float64),
            ("limited_by", np.uint64),
            ("iterations", np.int32),
            ("converged", np.bool_),
        ],
        align=True,
    )


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of tips in the base frame, one per row.

    Attributes:
        tip_m: tip positions [m], shape ``(rows, 3)``.
        direction: unit tangents there, same shape, or None.
        mid_m: positions of the mid-point [m], same shape, or None.
        load_n: known forces on the tip [N], same shape, or None for none.
        rotation: frames of the tip instead of directions, shape ``(rows, 3, 3)``, or None.
    """

    tip_m: Array
    direction: Array | None = None
    mid_m: Array | None = None
    load_n: Array | None = None
    rotation: Array | None = None

    @classmethod
    def of(
        cls,
        tip_m: ArrayLike,
        direction: ArrayLike | None = None,
        mid_m: ArrayLike | None = None,
        load_n: ArrayLike | None = None,
    ) -> Targets:
        """Targets without frames of anything array-like; one direction, mid-point or load serves every tip.

        Raises:
            ValueError: a shape other than ``(rows, 3)`` or ``(3,)``.
        """
        tips = matrix(tip_m, None, 3, "tip_m")
        rest = [
            None if given is None else matrix(given, len(tips), 3, name)
            for name, given in (("direction", direction), ("mid_m", mid_m), ("load_n", load_n))
        ]
        return cls(tips, *rest)

    def __len__(self) -> int:
        return len(self.tip_m)

    @property
    def computable(self) -> bool:
        """True where every row is finite and within `FAR_M`: kernels take no others."""
        points, rest = (self.tip_m, self.mid_m), (self.direction, self.rotation, self.load_n)
        near = all(np.all(np.abs(rows) <= FAR_M) for rows in points if rows is not None)  # NaN is not
        return near and all(np.all(np.isfinite(rows)) for rows in rest if rows is not None)


@dataclass(frozen=True, eq=False)
class Solutions:
    """Inverse kinematics of many rows.

    Attributes:
        rows: fields ``actuation`` (axes), ``residual_m``, ``limited_by`` (bits), ``iterations`` and
            ``converged``, each as in `contid.targets.Solution`; its note is left out.
        limit_names: names of the bits of ``limited_by``, the lowest first.
    """

    rows: Table
    limit_names: tuple[str, ...]

    def limited_by(self, row: int) -> tuple[str, ...]:
        """Names of the active limits of one row, in the order of the bits."""
        bits = int(self.rows["limited_by"][row])
        return tuple(name for k, name in enumerate(self.limit_names) if bits >> k & 1)


def matrix(given: ArrayLike, rows: int | None, columns: int, name: str) -> Array:
    """Contiguous floats ``(rows, columns)``; a single row is repeated.

    Raises:
        ValueError: another shape.
    """
    array = np.asarray(given, dtype=np.float64)
    if rows is not None and array.shape in ((columns,), (1, columns)):
        array = np.broadcast_to(array, (rows, columns))
    if array.ndim != 2 or array.shape[1] != columns or (rows is not None and len(array) != rows):
        shape = f"({'rows' if rows is None else rows}, {columns})"
        raise ValueError(f"{name}: shape {array.shape}; expected {shape}")
    return np.ascontiguousarray(array)
