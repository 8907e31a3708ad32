"""Interfaces of the kernels for batches; batches of arms of sections, by ``contid/kernels/arc/arc.cpp``."""

from __future__ import annotations

from typing import Any, Final, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.array import Array
from contid.kinematics.batch.rows import POSE, Solutions, Table, Targets, solution_dtype
from contid.targets import REACH

#: A table as the kernels take it, shape ``(rows, bytes of a row)``.
Bytes: TypeAlias = NDArray[np.uint8]

#: Chained rows are solved by the kernel.
CHAINS: Final = True


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


def forward(model: SectionModel, actuations: Array, load_n: Array | None, threads: int) -> Table:
    """Poses of rows of lengths [m]; loads do not bend this model."""
    return poses(cast(ManyForward, model.solver), actuations, threads)


def inverse(
    model: SectionModel, targets: Targets, seeds: Array, chained: bool, threads: int
) -> Solutions | None:
    """Lengths [m] for rows of targets; None for a model with another inverse."""
    if type(model) is not SectionModel:
        return None
    rows = np.zeros(len(targets), solution_dtype(len(model.axis_names)))
    cast(ManyInverse, model.solver).inverse_many(
        targets.tip_m, targets.direction, targets.mid_m, seeds, chained, in_bytes(rows), threads
    )
    free = ~rows["converged"] & (rows["limited_by"] == 0)
    rows["limited_by"][free] = 1 << model.limit_names.index(REACH)
    return Solutions(rows, model.limit_names)
