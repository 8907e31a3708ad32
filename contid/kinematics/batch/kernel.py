"""Interfaces of the kernels for batches, and their results as structured arrays."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid.kinematics.batch.rows import POSE, Table

#: A table as the kernels take it, shape ``(rows, bytes of a row)``.
Bytes: TypeAlias = NDArray[np.uint8]


@runtime_checkable
class ManyForward(Protocol):
    """Interface of a kernel that computes the poses of many rows."""

    def forward_many(self, actuations: Array, out: Bytes, threads: int) -> None:
        """Fill rows of `POSE`."""


@runtime_checkable
class ManyInverse(Protocol):
    """Interface of a kernel that solves the inverse of many rows."""

    def inverse_many(
        self,
        tip: Array,
        direction: Array | None,
        mid: Array | None,
        seeds: Array,
        chained: bool,
        out: Bytes,
        threads: int,
    ) -> None:
        """Fill rows of `solution_dtype`."""


def poses(kernel: ManyForward, actuations: Array, threads: int) -> Table:
    """The table of poses of a kernel."""
    rows = np.zeros(len(actuations), POSE)
    kernel.forward_many(actuations, in_bytes(rows), threads)
    return rows


def in_bytes(table: np.ndarray[Any, Any]) -> Bytes:
    """A table's memory, shape ``(rows, bytes of a row)``."""
    return table.view(np.uint8).reshape(len(table), table.dtype.itemsize)
