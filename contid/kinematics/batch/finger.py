"""Batches of two-rack fingers, by ``contid/kernels/finger/finger.hpp``; tips out of reach by single calls."""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.batch import loop
from contid.kinematics.batch.kernel import in_bytes, poses
from contid.kinematics.batch.rows import Solutions, Table, Targets, solution_dtype
from contid.kinematics.rack.finger import RackFingerModel

#: Every limit a finger's answer can name.
LIMITS: Final = (
    "arc_length.min", "curvature", "full_turn", "left.max", "left.min", "right.max", "right.min", "no_arc",
)  # fmt: skip


#: Chained rows are solved by the kernel.
CHAINS: Final = True


def forward(model: RackFingerModel, actuations: Array, load_n: Array | None, threads: int) -> Table:
    """Poses of rows of racks [m]; loads do not bend racks in this model."""
    return poses(model.kernel, actuations, threads)


def inverse(model: RackFingerModel, targets: Targets, seeds: Array, chained: bool, threads: int) -> Solutions:
    """Racks [m] for rows of targets; seeds have no effect."""
    rows = np.zeros(len(targets), solution_dtype(2))
    model.kernel.inverse_many(targets.tip_m, in_bytes(rows), threads)
    for k in np.flatnonzero(~rows["converged"]).tolist():
        rows[k] = loop.as_row(model.inverse(loop.target_of(targets, k), (0.0, 0.0)), LIMITS)
    return Solutions(rows, LIMITS)
