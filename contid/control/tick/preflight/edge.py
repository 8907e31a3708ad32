"""A step along the edge of the reach, in place of one that leads out of it.

A person at keys or a slider moves a tip or a bend in small steps. Where the reach of an arm is a surface, or
the arm is straight, which is the edge of its reach, no such step is in reach, but targets beside it are: the
nearest point to a tip, and for bends the nearest lengths of the sections with which they are within limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.kinematics.model import Bending
from contid.targets import Actuation, Target, Vec3

#: Least share of a step that has to be left of it.
_ONWARD: Final = 0.01
#: Least share of a step by which it leads beside the reach; solvers that approximate leave less.
_BESIDE: Final = 0.25
#: Bends that differ by less are the same: those of the last command, computed back from its actuation.
_ROUNDING_RAD: Final = 1e-7
#: What is longer is no step but an order to somewhere else: share of the distance of the tip from the base,
#: or of the lengths of the sections.
_LONGEST: Final = 0.1
#: Bisections between lengths out of the limits and lengths within them.
_HALVINGS: Final = 40


def along_the_edge(config: RobotConfig, target: Target, begin: Target, seed: Actuation) -> Target | None:
    """The target within reach beside a tip, or bends, that are out of it, to go to in their place.

    None for targets of other kinds and for those that are far away, where the nearest one that was found is
    farther away than where the step begins, and where it leads nowhere.

    Args:
        config: of the robot.
        target: in the world frame, out of reach.
        begin: where the step begins: the same kind of target.
        seed: the last command.
    """
    if target.arcs is not None and begin.arcs is not None:
        return _with_lengths(config, target, begin.arcs, seed)
    if target.tip_m is None or begin.tip_m is None or target.direction or target.rotation or target.mid_m:
        return None
    in_base = config.frame.target_in_base(target)
    found = config.model.inverse(in_base, seed).actuation
    tip_m = config.frame.point_in_world(config.model.forward(found, in_base.load_n).tip_m)
    if not _is_step(config, target.tip_m, begin.tip_m):
        return None
    if math.dist(tip_m, target.tip_m) < math.dist(begin.tip_m, target.tip_m):
        return replace(target, tip_m=tip_m) if _leads_on(begin.tip_m, target.tip_m, tip_m) else None
    return None


def off_the_reach_m(config: RobotConfig, target: Target, begin: Target, seed: Actuation) -> float:
    """How far a step of a tip, or of bends, leads out of the reach [m], also where a tolerance takes it.

    0 for what is within reach, and for what is no step. Taken as it is, such a step would move nothing until
    a person has gone beyond the tolerance of the solution or `reach_tolerance_mm`: an azimuth of an arm that
    bends in a plane, for one. The arguments are those of `along_the_edge`.
    """
    if target.arcs is not None and begin.arcs is not None:
        return _bends_left_m(config, target, begin.arcs, seed)
    if target.tip_m is None or begin.tip_m is None or target.direction or target.rotation or target.mid_m:
        return 0.0
    if not _is_step(config, target.tip_m, begin.tip_m):
        return 0.0
    off_m = config.model.inverse(config.frame.target_in_base(target), seed).residual_m
    return off_m if off_m > _BESIDE * math.dist(begin.tip_m, target.tip_m) else 0.0


def _bends_left_m(config: RobotConfig, target: Target, begin: Sequence[float], seed: Actuation) -> float:
    """What is left of a step of bends, times the lengths [m]; 0 where that is less than `_BESIDE` of it."""
    assert target.arcs is not None
    assert isinstance(config.model, Bending)
    in_base = config.frame.target_in_base(target)
    solved = config.model.inverse(in_base, seed)
    found = config.model.arcs(solved.actuation, in_base.load_n).ravel().tolist()
    asked, before, after = (
        [a for k, a in enumerate(each) if k % 3 < 2] for each in (target.arcs, begin, found)
    )
    left, step = math.dist(asked, after), math.dist(asked, before)
    return left * sum(found[2::3]) if left > _BESIDE * step and step > _ROUNDING_RAD else 0.0


def _is_step(config: RobotConfig, tip_m: Vec3, begin_m: Vec3) -> bool:
    return math.dist(begin_m, tip_m) <= _LONGEST * math.dist(begin_m, config.frame.origin_in_world)


def _with_lengths(
    config: RobotConfig, target: Target, begin: Sequence[float], seed: Actuation
) -> Target | None:
    """The same bends with the nearest lengths, on the way to those of the model's choice, within limits."""
    asked, model = target.arcs or (), config.model
    if math.dist(begin[2::3], asked[2::3]) > _LONGEST * sum(begin[2::3]):
        return None
    in_base = config.frame.target_in_base(target)  # its load; bends are the same in both frames
    free = replace(in_base, arcs=tuple([0.0 if k % 3 == 2 else each for k, each in enumerate(asked)]))
    found = model.inverse(free, seed)
    if not found.converged or not isinstance(model, Bending):
        return None
    chosen = model.arcs(found.actuation, in_base.load_n).ravel().tolist()
    outside, inside = 0.0, 1.0
    nearest = target
    for _ in range(_HALVINGS):
        share = 0.5 * (outside + inside)
        lengths = zip(asked, chosen, strict=True)
        arcs = [a + share * (b - a) if k % 3 == 2 else a for k, (a, b) in enumerate(lengths)]
        if model.inverse(replace(in_base, arcs=tuple(arcs)), seed).converged:
            inside, nearest = share, replace(target, arcs=tuple(arcs))
        else:
            outside = share
    if nearest.arcs is None or not _leads_on(begin, asked, nearest.arcs):
        return None
    return None if _bends_left_m(config, nearest, begin, seed) > 0.0 else nearest


def _leads_on(begin: Sequence[float], asked: Sequence[float], found: Sequence[float]) -> bool:
    return math.dist(begin, found) > _ONWARD * math.dist(begin, asked)
