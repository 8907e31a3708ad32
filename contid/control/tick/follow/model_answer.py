"""The answer of the model to the target of a tick.

A target out of reach takes a search, which costs up to a hundred times as much as another answer. So its
answer is kept for the same question. By motion rules 7 the nearest pose to a tip out of reach is kept while
this stands, and followed while it moves on by no more than `SEARCHED_M`, however far the axes are behind:
asked from their command, the model would search everywhere in every tick until they have caught up.
"""

from __future__ import annotations

import math
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.state import Answered, RobotState
from contid.kinematics.model import Following
from contid.targets import Solution, Target, are_numbers

#: A tip out of reach that has moved on by this since the last search everywhere is searched for again [m].
SEARCHED_M: Final = 5e-3


def answered(config: RobotConfig, state: RobotState, in_base: Target) -> Answered:
    """The answer of the model to a target in the base frame.

    Raises:
        TypeError: the model answered something else than a solution.
        ValueError: it has another number of axes.
    """
    model, missed, seed, tip_m = config.model, state.missed, state.command, in_base.tip_m
    if missed is not None and missed.joined_s == state.since_s:
        same = missed.target_in_base == in_base
        if (
            config.motion_rules > 6
            and tip_m is not None
            and in_base.direction is in_base.rotation is in_base.mid_m is None
            and isinstance(model, Following)
            and model.follows(in_base.load_n)
        ):
            seed, searched_m = missed.solution.actuation, missed.searched_m
            if same and searched_m == tip_m:
                return missed
            if not same and searched_m is not None and math.dist(searched_m, tip_m) <= SEARCHED_M:
                solution = _checked(config, model.follow(in_base, seed))
                return Answered(in_base, seed, solution, state.since_s, searched_m)
        elif same and missed.seed == seed:
            return missed
    return Answered(in_base, seed, _checked(config, model.inverse(in_base, seed)), state.since_s, tip_m)


def _checked(config: RobotConfig, answer: Solution) -> Solution:
    """What a model answered, which may be anybody's.

    Raises:
        TypeError: it is no solution.
        ValueError: it has another number of axes.
    """
    if not isinstance(answer, Solution):
        raise TypeError(f"the model answered {answer!r}, not a solution")
    if len(answer.actuation) != len(config.axes):
        raise ValueError(f"the model answered {answer.actuation} for {len(config.axes)} axes")
    numbers = (*answer.actuation, answer.residual_m, answer.iterations)
    if not are_numbers(numbers):
        raise TypeError(f"the model answered {answer}, and not all of it are numbers")
    if answer.limited_by and not all(isinstance(name, str) for name in answer.limited_by):
        raise TypeError(f"the model answered limited_by={answer.limited_by!r}, and not all of it are names")
    return answer
