"""Forward and inverse kinematics of many rows at once, for programs that are not the control process.

Every row is what the single call of `Model` returns for it, bit for bit; the number of threads
changes nothing. Batches run in the kernel of a model where it has one for them, else in a loop.
"""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from contid.kinematics.any_target import tolerance_of
from contid.kinematics.batch import loop
from contid.kinematics.batch.rows import POSE, Solutions, Table, Targets, matrix
from contid.kinematics.model import Model

__all__ = ["POSE", "Solutions", "Table", "Targets", "chains", "forward_many", "inverse_many"]


#: Class of a model -> the module with its ``forward`` and ``inverse`` for batches; one returns None where
#: no kernel solves it; the loop is used then. The class of an extra has its module as its ``BATCH``.
BATCHES: Final = {
    "contid.kinematics.arc.section_model:SectionModel": "contid.kinematics.batch.kernel",
    "contid.kinematics.cosserat.model:CosseratModel": "contid.kinematics.batch.pneumatic",
    "contid.kinematics.rack.finger:RackFingerModel": "contid.kinematics.batch.finger",
}


def forward_many(
    model: Model, actuations: ArrayLike, load_n: ArrayLike | None = None, *, threads: int | None = None
) -> Table:
    """Poses of the tip in the base frame, a row of `POSE` per row of actuation.

    Args:
        model: a model that `build_model` made.
        actuations: actuations in the model's order [m or Pa], shape ``(rows, axes)``.
        load_n: known forces on the tip [N], shape ``(rows, 3)`` or ``(3,)``.
        threads: number of threads to divide the rows between; None for every processor this process may use.

    Raises:
        ValueError: a wrong shape or number of threads.
    """
    rows = matrix(actuations, None, len(model.axis_names), "actuations")
    loads = None if load_n is None else matrix(load_n, len(rows), 3, "load_n")
    count, batch = _count(threads), _batch_of(model)
    found: Table | None = None if batch is None else batch.forward(model, rows, loads, count)
    return loop.forward(model, rows, loads) if found is None else found


def inverse_many(
    model: Model, targets: Targets, seeds: ArrayLike, *, chained: bool = False, threads: int | None = None
) -> Solutions:
    """Actuation for each target, inside every limit.

    Args:
        model: a model that `build_model` made.
        targets: targets in the base frame.
        seeds: the last commanded actuation [m or Pa], one for all rows ``(axes,)`` or one per row
            ``(rows, axes)``.
        chained: each row starts from the answer of the row before, the first from ``seeds`` ``(axes,)``; one
            thread then does all rows.
        threads: number of threads to divide the rows between; None for every processor this process may use.

    Raises:
        ValueError: a wrong shape or number of threads, or a target of a kind the model does not take.
    """
    axes = len(model.axis_names)
    starts = matrix(seeds, 1 if chained else len(targets), axes, "seeds")
    count, batch = _count(threads), _batch_of(model)
    found: Solutions | None = None
    if batch is not None and targets.rotation is None and targets.computable:
        # Kernels take a row each, also where one seed serves all.
        found = batch.inverse(model, targets, np.ascontiguousarray(starts), chained, count)
    if found is None:
        return loop.inverse(model, targets, starts, chained)
    found.rows["converged"] |= found.rows["residual_m"] <= tolerance_of(model)
    return found


def chains(model: Model) -> bool:
    """True where a kernel answers tips of which each begins at the answer to the one before (``chained``)."""
    return getattr(_batch_of(model), "CHAINS", False)


def _batch_of(model: Model) -> ModuleType | None:
    kind = type(model)
    name = BATCHES.get(f"{kind.__module__}:{kind.__qualname__}", getattr(kind, "BATCH", None))
    return None if name is None else import_module(name)


def _count(threads: int | None) -> int:
    """Number of threads to use."""
    if threads is None:
        return len(os.sched_getaffinity(0))
    if threads < 1:
        raise ValueError(f"threads: {threads}; expected 1 or more")
    return threads
