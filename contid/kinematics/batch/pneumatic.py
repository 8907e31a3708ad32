"""Batches of pneumatic arms, by ``contid/kernels/cosserat/search.cpp``: mm and bar there, SI here."""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.batch import loop
from contid.kinematics.batch.kernel import in_bytes
from contid.kinematics.batch.rows import POSE, Solutions, Table, Targets, solution_dtype
from contid.kinematics.cosserat.model import CosseratModel
from contid.units import MM_PER_M

# Bits the kernel leaves in `limited_by`.
_OPTIMAL, _STABLE, _BLOCKED, _SNAPS = (np.uint64(1 << k) for k in range(4))
_NONE: Final = np.uint64(0)


def forward(model: CosseratModel, actuations: Array, load_n: Array | None, threads: int) -> Table:
    """Poses of pressures ``(rows, axes)`` [Pa] under loads ``(rows, 3)`` [N]."""
    rows = np.zeros(len(actuations), POSE)
    model.engine.forward_many(model.regulators.chamber_rows(actuations), load_n, in_bytes(rows), threads)
    rows["tip_m"] /= MM_PER_M
    rows["mid_m"] /= MM_PER_M
    return rows


def inverse(
    model: CosseratModel, targets: Targets, seeds: Array, chained: bool, threads: int
) -> Solutions | None:
    """Pressures [Pa] for targets, from ``seeds`` of shape ``(rows, axes)`` [Pa].

    None where a row needs the one before (``chained``). Rows whose answer the kernel finds unstable are
    solved again by the model itself.
    """
    if chained:
        return None
    rows = np.zeros(len(targets), solution_dtype(len(model.axis_names)))
    model.engine.inverse_many(
        targets.tip_m * MM_PER_M,
        None if targets.mid_m is None else targets.mid_m * MM_PER_M,
        targets.direction,
        targets.load_n,
        model.regulators.chamber_rows(seeds),
        in_bytes(rows),
        threads,
    )
    refused = np.flatnonzero(rows["limited_by"] & _STABLE == _NONE).tolist()
    rows["actuation"] = model.regulators.command_rows(rows["actuation"])
    _in_si(rows, np.array(model.lower), np.array(model.upper))
    for k in refused:
        found = model.inverse(loop.target_of(targets, k), tuple(seeds[k].tolist()))
        rows[k] = loop.as_row(found, model.limit_names)
    return Solutions(rows, model.limit_names)


def _in_si(rows: Table, lower: Array, upper: Array) -> None:
    """Pressures in the limits, residuals in m, and the names of limits that `CosseratModel.inverse` gives."""
    axes, away = len(lower), ~rows["converged"]
    why = rows["limited_by"][away]
    p = rows["actuation"]
    low = np.where(lower > p, lower, p)
    held = np.where(upper < low, upper, low)
    rows["actuation"] = np.where(away[:, None], held, p)
    rows["residual_m"] /= MM_PER_M
    at_low, at_high = held[away] <= lower, held[away] >= upper
    limited = np.zeros(len(why), np.uint64)
    for k in range(axes):
        limited |= at_low[:, k].astype(np.uint64) << np.uint64(2 * k)
        limited |= (~at_low[:, k] & at_high[:, k]).astype(np.uint64) << np.uint64(2 * k + 1)
    unstable = (why & (_SNAPS | _BLOCKED)) != _NONE
    unfinished = ~unstable & (why & _OPTIMAL == _NONE)
    limited |= unstable.astype(np.uint64) << np.uint64(2 * axes)
    limited |= unfinished.astype(np.uint64) << np.uint64(2 * axes + 1)
    limited |= (limited == _NONE).astype(np.uint64) << np.uint64(2 * axes + 2)
    rows["limited_by"] = _NONE
    rows["limited_by"][away] = limited
