"""Where the tip is to be in an episode: at a place, on a path, or at its place while a load is put on."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_learn.views import RobotView, TipGoal

#: Time from one place of a path to the next [s], at the least.
LEG_S: Final = 2.0
#: Share of the greatest velocity of the axes that a path needs at the most.
PATH_SHARE: Final = 0.5
#: Poses of a path, between which it is straight.
WAYPOINTS: Final = 33


class Task(enum.StrEnum):
    """What a policy is to do."""

    REACH = "reach"  # one place for the whole episode
    FOLLOW = "follow"  # to and fro between two places
    HOLD = "hold"  # one place, and a load is put on the tip meanwhile


@dataclass(frozen=True, slots=True, eq=False)
class GoalPath:
    """To and fro between the axes of two poses, at rest at both.

    Attributes:
        tips: along the way there, shape ``(k, d)``.
        leg_s: time of one way.
    """

    tips: Array
    leg_s: float

    def at(self, time_s: float) -> TipGoal:
        """The goal at a time, and its velocity."""
        phase = math.pi * time_s / self.leg_s
        place = 0.5 * (1.0 - math.cos(phase)) * (len(self.tips) - 1)
        rate = 0.5 * math.sin(phase) * math.pi / self.leg_s * (len(self.tips) - 1)
        before = min(int(place), len(self.tips) - 2)
        way = self.tips[before + 1] - self.tips[before]
        return TipGoal(self.tips[before] + (place - before) * way, rate * way)


def drawn_paths(task: Task, views: Sequence[RobotView], rng: np.random.Generator) -> dict[str, GoalPath]:
    """The paths of the goals of an episode by robot; a place is a path that does not move."""
    paths = {}
    for view in views:
        poses = view.reachable.axes
        place = poses[rng.integers(len(poses))]
        other = poses[rng.integers(len(poses))] if task is Task.FOLLOW else place
        share = np.linspace(0.0, 1.0, WAYPOINTS if task is Task.FOLLOW else 2)[:, None]
        tips = view.robot.fk(place + share * (other - place)).tip
        fastest_s = 0.5 * math.pi * float(np.abs(other - place).max()) / (PATH_SHARE * view.velocity)
        paths[view.name] = GoalPath(tips, max(LEG_S, fastest_s))
    return paths
