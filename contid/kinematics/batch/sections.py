"""Batches of arms of sections, by ``contid/kernels/arc/batch.hpp``."""

from __future__ import annotations

import numpy as np

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.array import Array
from contid.kinematics.batch.kernel import ManyForward, ManyInverse, in_bytes, poses
from contid.kinematics.batch.rows import Solutions, Table, Targets, solution_dtype
from contid.targets import REACH


def forward(model: SectionModel, actuations: Array, load_n: Array | None, threads: int) -> Table | None:
    """Poses of rows of lengths [m]; loads do not bend this model. None without a kernel."""
    solver = model.solver
    return poses(solver, actuations, threads) if isinstance(solver, ManyForward) else None


def inverse(
    model: SectionModel, targets: Targets, seeds: Array, chained: bool, threads: int
) -> Solutions | None:
    """Lengths [m] for rows of targets. None without a kernel."""
    solver = model.solver
    if type(model) is not SectionModel or not isinstance(solver, ManyInverse):
        return None
    rows = np.zeros(len(targets), solution_dtype(len(model.axis_names)))
    solver.inverse_many(
        targets.tip_m, targets.direction, targets.mid_m, seeds, chained, in_bytes(rows), threads
    )
    free = ~rows["converged"] & (rows["limited_by"] == 0)
    rows["limited_by"][free] = 1 << model.limit_names.index(REACH)
    return Solutions(rows, model.limit_names)
