"""Rows and ticks of a trajectory that are computed together, where nothing is in the way of any of them.

A check that is computed tick by tick spends most of its time between the kernels. Where a robot follows tips
with a model whose kernel answers many of them at once, a block of ticks is answered, and the part of it is
taken in which every answer is within reach and is commanded as it is. There the check has nothing to find,
and the state behind it is that of single ticks, bit for bit. From the first tick with anything else on, ticks
are computed one by one, until a block is clean again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import followed
from contid.control.tick.shared_limits import reaches_shared
from contid.kinematics.array import Array
from contid.kinematics.batch import Targets, chains, inverse_many
from contid.targets import Actuation
from contid.trajectory.timed import Trajectory

#: Rows or ticks of a block: at first, and at most; a clean block is followed by one of twice the size.
LEAST: Final = 64
MOST: Final = 8192
#: Single ones that follow a block that was not clean.
SINGLES: Final = 64


class BlockSize:
    """Size of the next block."""

    def __init__(self) -> None:
        self.size = LEAST

    def after(self, clean: int, asked: int) -> int:
        """Single ones that follow a block of which ``clean`` were clean."""
        if clean == asked:
            self.size = min(2 * self.size, MOST)
            return 0
        self.size = LEAST
        return SINGLES


def takes_blocks(trajectory: Trajectory, configs: Sequence[RobotConfig]) -> bool:
    """True where every robot follows nothing but its tip, with a model that answers many in a row."""
    of = {config.name: config for config in configs}
    for columns in trajectory.layout.robots:
        if columns.robot not in of:
            return False
        if not columns.tip or columns.load or set(columns.moving) != set(columns.tip):
            return False
        if not chains(of[columns.robot].model):
            return False
    return True


def tips_in_base(trajectory: Trajectory, config: RobotConfig, rows: Array) -> Array:
    """Tips of a robot in its base frame, shape ``(n, 3)`` [m], in rows of the columns in SI.

    The operations of `contid.kinematics.frames.BaseFrame.point_in_base` in their order.
    """
    columns = next(each for each in trajectory.layout.robots if each.robot == config.name).tip
    origin, r = config.frame.origin_in_world, config.frame.rotation
    z = rows[:, columns[2]] if len(columns) == 3 else np.zeros(len(rows))
    x, y, z = rows[:, columns[0]] - origin[0], rows[:, columns[1]] - origin[1], z - origin[2]
    return np.column_stack([r[k] * x + r[3 + k] * y + r[6 + k] * z for k in range(3)])


def reached(config: RobotConfig, tips: Array, seed: Actuation) -> Array:
    """Answers to the first tips, shape ``(n, 3)`` in the base frame, each from the one before.

    They end before the first that is out of reach.
    """
    found = inverse_many(config.model, Targets(tips), seed, chained=True, threads=1).rows
    missed = np.flatnonzero(~found["converged"])
    answers: Array = found["actuation"][: missed[0] if len(missed) else None]
    return np.ascontiguousarray(answers)


def clean(config: RobotConfig, tips: Array, last: Actuation, last_steps: Actuation) -> Array:
    """Answers to the first tips, one a tick, that are within reach and commanded as they are.

    Args:
        config: of a robot without tensions.
        tips: in the base frame, shape ``(n, 3)`` [m].
        last: the last command, which was on its target.
        last_steps: the last command minus the one before.
    """
    answers = reached(config, tips, last)
    answers = answers[: followed(config.limits, last, last_steps, answers)]
    if config.shared is None:
        return answers
    return answers[: reaches_shared(config.shared, config.limits, last, answers)]
