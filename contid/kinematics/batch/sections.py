"""Batches of arms of sections, by ``contid/kernels/arc/batch.hpp``."""

from __future__ import annotations

from typing import cast

import numpy as np

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.array import Array
from contid.kinematics.batch.kernel import ManyForward, ManyInverse, in_bytes, poses
from contid.kinematics.batch.rows import Solutions, Table, Targets, solution_dtype
from contid.targets import REACH


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
