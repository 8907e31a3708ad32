"""A batch as single calls: specification of the kernels, and used for models without one."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.batch.rows import POSE, Poses, Solutions, Targets, solution_dtype
from contid.kinematics.model import Model
from contid.targets import ZERO3, Target, Vec3

# Bits of the field `limited_by`.
_BITS = 64


def forward(model: Model, actuations: Array, load_n: Array | None) -> Poses:
    """`Model.forward` of every row."""
    rows = np.zeros(len(actuations), POSE)
    for k, actuation in enumerate(actuations.tolist()):
        pose = model.forward(tuple(actuation), ZERO3 if load_n is None else _vec3(load_n[k]))
        rotation = np.array(pose.rotation).reshape(3, 3)
        rows[k] = (pose.tip_m, rotation, pose.direction, pose.mid_m, pose.stable)
    return Poses(rows)


def inverse(model: Model, targets: Targets, seeds: Array, chained: bool) -> Solutions:
    """`Model.inverse` of every row; limits are numbered as the model lists them, others as they appear."""
    rows = np.zeros(len(targets), solution_dtype(len(model.axis_names)))
    bits: dict[str, int] = {name: k for k, name in enumerate(getattr(model, "limit_names", ()))}
    seed: tuple[float, ...] = ()
    for k in range(len(targets)):
        if k == 0 or not chained:
            seed = tuple(seeds[k].tolist())
        found = model.inverse(target_of(targets, k), seed)
        seed = found.actuation
        limited = 0
        for name in found.limited_by:
            limited |= 1 << bits.setdefault(name, len(bits))
        if len(bits) > _BITS:
            raise ValueError(f"more than {_BITS} limits: {', '.join(bits)}")
        rows[k] = (found.actuation, found.residual_m, limited, found.iterations, found.converged)
    return Solutions(rows, tuple(bits))


def target_of(targets: Targets, row: int) -> Target:
    """One row as the single call takes it."""
    return Target(
        tip_m=_vec3(targets.tip_m[row]),
        direction=None if targets.direction is None else _vec3(targets.direction[row]),
        mid_m=None if targets.mid_m is None else _vec3(targets.mid_m[row]),
        load_n=ZERO3 if targets.load_n is None else _vec3(targets.load_n[row]),
        rotation=None if targets.rotation is None else tuple(targets.rotation[row].ravel().tolist()),
    )


def _vec3(row: Array) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z
