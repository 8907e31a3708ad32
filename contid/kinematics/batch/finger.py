"""Batches of two-rack fingers, by ``contid/kernels/finger/finger.hpp``; tips out of reach by single calls."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.batch import loop
from contid.kinematics.batch.kernel import Bytes, ManyForward, in_bytes, poses
from contid.kinematics.batch.rows import Solutions, Table, Targets, solution_dtype
from contid.kinematics.rack.finger import RackFingerModel

#: Every limit a finger's answer can name.
LIMITS: Final = (
    "arc_length.min", "curvature", "full_turn", "left.max", "left.min", "right.max", "right.min", "no_arc",
)  # fmt: skip


#: Chained rows are solved by the kernel.
CHAINS: Final = True


class _FingerKernel(ManyForward, Protocol):
    def inverse_many(self, tip: Array, out: Bytes, threads: int) -> None: ...


def forward(model: RackFingerModel, actuations: Array, load_n: Array | None, threads: int) -> Table:
    """Poses of rows of racks [m]; loads do not bend racks in this model."""
    return poses(_kernel_of(model), actuations, threads)


def inverse(model: RackFingerModel, targets: Targets, seeds: Array, chained: bool, threads: int) -> Solutions:
    """Racks [m] for rows of targets; seeds have no effect."""
    rows = np.zeros(len(targets), solution_dtype(2))
    _kernel_of(model).inverse_many(targets.tip_m, in_bytes(rows), threads)
    for k in np.flatnonzero(~rows["converged"]).tolist():
        rows[k] = loop.as_row(model.inverse(loop.target_of(targets, k), (0.0, 0.0)), LIMITS)
    return Solutions(rows, LIMITS)


def _kernel_of(model: RackFingerModel) -> _FingerKernel:
    envelope = model.envelope
    kernel: _FingerKernel = load("finger").Finger(
        model.rack_spacing_m,
        model.tip_length_m,
        model.gain_per_m,
        model.gain_offset,
        *model.gain_range_m,
        envelope.length_min_m,
        envelope.length_max_m,
        envelope.curvature_max_per_m,
        envelope.arc_length_min_m,
    )
    return kernel
