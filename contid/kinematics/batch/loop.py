"""A batch as single calls, for models without a kernel for batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.batch.rows import POSE, Solutions, Table, Targets, solution_dtype
from contid.kinematics.model import Model
from contid.targets import ZERO3, Actuation, Solution, Target, vec3

# Bits of the field `limited_by`.
_BITS = 64


def forward(model: Model, actuations: Array, load_n: Array | None) -> Table:
    """`Model.forward` of every row."""
    rows = np.zeros(len(actuations), POSE)
    for k, actuation in enumerate(actuations.tolist()):
        pose = model.forward(tuple(actuation), ZERO3 if load_n is None else vec3(load_n[k].tolist()))
        rotation = np.array(pose.rotation).reshape(3, 3)
        rows[k] = (pose.tip_m, rotation, pose.direction, pose.mid_m, pose.stable)
    return rows


def inverse(model: Model, targets: Targets, seeds: Array, chained: bool) -> Solutions:
    """`Model.inverse` of every row; limits are numbered as the model lists them, others as they appear."""
    return inverse_each(model, [target_of(targets, k) for k in range(len(targets))], seeds, None, chained)


def inverse_each(
    model: Model,
    targets: Sequence[Target],
    seeds: Array,
    loads: Array | None = None,
    chained: bool = False,
) -> Solutions:
    """`Model.inverse` of targets of any kind; see `inverse`.

    Args:
        model: any.
        targets: in the base frame.
        seeds: one for all ``(axes,)``, or one per target.
        loads: forces on the tip ``(targets, 3)`` [N]; None: those of the targets.
        chained: each begins with the answer of the one before.
    """
    rows = np.zeros(len(targets), solution_dtype(len(model.axis_names)))
    if seeds.ndim == 1:
        seeds = np.broadcast_to(seeds, (len(targets), len(seeds)))
    names = list(getattr(model, "limit_names", ()))
    seed: tuple[float, ...] = ()
    for k, target in enumerate(targets):
        if k == 0 or not chained:
            seed = tuple(seeds[k].tolist())
        if loads is not None:
            target = replace(target, load_n=vec3(loads[k].tolist()))
        found = model.inverse(target, seed)
        seed = found.actuation
        names += [name for name in dict.fromkeys(found.limited_by) if name not in names]
        if len(names) > _BITS:
            raise ValueError(f"more than {_BITS} limits: {', '.join(names)}")
        rows[k] = as_row(found, names)
    return Solutions(rows, tuple(names))


def as_row(found: Solution, names: Sequence[str]) -> tuple[Actuation, float, int, int, bool]:
    """A row of `solution_dtype`; ``names``: of the bits of the limits."""
    limited = sum(1 << names.index(name) for name in set(found.limited_by))
    return found.actuation, found.residual_m, limited, found.iterations, found.converged


def target_of(targets: Targets, row: int) -> Target:
    """One row as the single call takes it."""
    return Target(
        tip_m=vec3(targets.tip_m[row].tolist()),
        direction=None if targets.direction is None else vec3(targets.direction[row].tolist()),
        mid_m=None if targets.mid_m is None else vec3(targets.mid_m[row].tolist()),
        load_n=ZERO3 if targets.load_n is None else vec3(targets.load_n[row].tolist()),
        rotation=None if targets.rotation is None else tuple(targets.rotation[row].ravel().tolist()),
    )
