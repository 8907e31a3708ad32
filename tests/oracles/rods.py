"""Redundant answers of the pneumatic arm solved again: pressures drawn in the box or near rest."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid.targets import Target
from contid.units import BAR

#: How far an answer may move when it is solved again from itself [bar].
FIXED_BAR = 1e-6
#: Share of the range of pressures: the box, and near rest, where the preferred pressures are far away.
NEAR_REST = 0.12


def moves(
    share: float, directed: bool, load_n: float, cases: int | Iterable[int], seed: int = 16
) -> tuple[int, list[float]]:
    """Targets not met, and how far each other answer moves when solved again [bar].

    Args:
        cases: how many to draw, or the numbers of those to solve.
    """
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    low, high = np.array(model.lower), np.array(model.upper)
    rng = np.random.default_rng(seed)
    load = (0.0, 0.0, load_n)
    missed, moved = 0, []
    chosen = set(range(cases) if isinstance(cases, int) else cases)
    for case in range(max(chosen) + 1):
        pressures, start = (
            tuple((low + rng.uniform(0.0, share, len(low)) * (high - low)).tolist()) for _ in range(2)
        )
        if case not in chosen:
            continue
        pose = model.forward(pressures, load)
        target = Target(pose.tip_m, pose.direction if directed else None, load_n=load)
        first = model.inverse(target, start)
        if not first.converged:
            missed += 1
            continue
        again = model.inverse(target, first.actuation)
        moved.append(float(np.abs(np.subtract(again.actuation, first.actuation)).max()) / BAR)
    return missed, moved
