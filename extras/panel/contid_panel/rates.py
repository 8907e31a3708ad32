"""How fast the columns of a robot change at full speed, when its axes move at their limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import numpy as np

from contid.kinematics.array import Array
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
    fastest = []
    for here in samples:
        speeds = []
        for moved in _moved(robot, here):
            with suppress(ValueError, ArithmeticError):  # outside the domain of the model
                speeds.append(math.dist(model.forward(here).tip_m, model.forward(moved).tip_m) / STEP_S)
        if speeds:
            fastest.append(max(speeds))
    return float(np.median(fastest)) * MM_PER_M if fastest else 0.0


def bend_rates(robot: RobotScene, description: RobotDescription, samples: Sequence[Actuation]) -> list[float]:
    """The same for every column of the bends, in its unit per second."""
    model = robot.config.model
    assert isinstance(model, Bending)

    def bends(actuation: Actuation) -> Array:
        return np.array(arc_values(description, model.arcs(actuation).tolist()))

    fastest = []
    for here in samples:
        before = bends(here)
        changes = np.abs([bends(moved) - before for moved in _moved(robot, here)])
        fastest.append(np.minimum(changes, np.abs(TURN_DEG - changes)).max(axis=0) / STEP_S)
    found: list[float] = np.median(fastest, axis=0).tolist()
    return found


def _moved(robot: RobotScene, here: Actuation) -> list[Actuation]:
    """An actuation a step later, for one moving axis after the other."""
    steps = [rate * STEP_S for rate in robot.config.velocity]
    return [(*here[:axis], here[axis] + step, *here[axis + 1 :]) for axis, step in enumerate(steps)]
