"""How fast the columns of a robot change at full speed, when its axes move at their limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.kinematics.model import Bending
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.trajectory.arc_columns import arc_values
from contid.units import MM_PER_M
from contid_view.robot_scene import RobotScene

#: Time over which the change of a column is taken [s].
STEP_S: Final = 1e-3
#: Full turns are left out of the changes of azimuths [deg].
TURN_DEG: Final = 360.0


def tip_rate_mm_s(robot: RobotScene, samples: Sequence[Actuation]) -> float:
    """Speed of the tip while its fastest axis moves at its limit: the median over samples [mm/s]."""
    model = robot.config.model
    speeds = []
    for here, moved in _moved(robot, samples):
        try:
            speeds.append(
                math.dist(model.forward(here).tip_m, model.forward(moved).tip_m) * MM_PER_M / STEP_S
            )
        except (ValueError, ArithmeticError):  # outside the domain of the model
            continue
    return _typical(speeds, len(robot.config.model.lower))


def bend_rates(robot: RobotScene, description: RobotDescription, samples: Sequence[Actuation]) -> list[float]:
    """The same for every column of the bends, in its unit per second."""
    model = robot.config.model
    assert isinstance(model, Bending)
    changes = []
    for here, moved in _moved(robot, samples):
        before, after = (
            np.array(arc_values(description, model.arcs(each).tolist())) for each in (here, moved)
        )
        change = np.abs(after - before)
        changes.append(np.minimum(change, np.abs(TURN_DEG - change)) / STEP_S)
    axes = len(model.lower)
    return [_typical([float(each) for each in column], axes) for column in np.array(changes).T]


def _moved(robot: RobotScene, samples: Sequence[Actuation]) -> list[tuple[Actuation, Actuation]]:
    """Every sample, and it a step later, for one moving axis after the other."""
    own = range(len(robot.config.model.lower))
    pairs = []
    for sample in samples:
        here = tuple(sample)
        for axis in own:
            step = robot.config.velocity[axis] * STEP_S
            pairs.append((here, (*here[:axis], here[axis] + step, *here[axis + 1 :])))
    return pairs


def _typical(speeds: Sequence[float], axes: int) -> float:
    """The median over samples of the fastest axis; 0 without any."""
    fastest = [max(speeds[first : first + axes]) for first in range(0, len(speeds), axes)]
    return float(np.median(fastest)) if fastest else 0.0
