"""The straight line of a tip from rest to a row that jumped: one jerk-limited motion of its share.

The tip goes along the line, its direction along the great circle, a mid-point along its own line, all by the
same share s of the way. The axes are functions of s, from the model's answers to `POINTS` targets on it; with
their greatest derivatives q', q'', q''' the bounds

    |q'| v <= V        |q''| v^2 + |q'| a <= A        |q'''| v^3 + 3 |q''| v a + |q'| j <= J

hold: each term has the share of `V`, `A` or `J` that a constant below gives it, which makes each rate of s a
quotient. The derivatives are difference quotients: where the answers of a model are kinked or jump between
the `POINTS` shares, as those of redundant arms may, the line would be slow, and is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from contid.control.tick.axis_motions import PresentRates, motion_to
from contid.control.tick.config import RobotConfig
from contid.control.tick.tip_task import between, turned
from contid.targets import Actuation, Target
from contid.trajectory.approach import Approach

#: Targets on the line for which the model is asked, the ends included.
POINTS: Final = 9
#: Share of `V` for |q'| v.
_SPEED: Final = 0.97
#: Share of `A` for |q''| v^2, and of `J` for |q'''| v^3 and for 3 |q''| v a.
_CURVED: Final = 0.25
_TWISTED: Final = 0.1
_BOTH: Final = 0.25
#: Share of `A`, and of `J`, for all terms together; what the others leave is for |q'| a, and |q'| j.
_REST: Final = 0.95
#: A line that takes this many times as long as the axes to their answer is none, since motion rules 8: those
#: of `finger` and `trirack` took up to 4.6 times, of the redundant `trirack2` up to 62.
_SLOWER: Final = 5.0


class TipLine:
    """A motion on a straight line, or None of it where the model leaves the line (`tip_line`).

    Attributes:
        duration_s: of the motion.
    """

    def __init__(self, start: Target, end: Target, motion: Approach) -> None:
        self._start, self._end = start, end
        self._motion = motion
        self.duration_s = motion.duration_s

    def at(self, time_s: float) -> Target:
        """The target at a time after the start."""
        if time_s >= self.duration_s:
            return self._end
        return point(self._start, self._end, self._motion.at(time_s)[0][0])


def point(start: Target, end: Target, share: float) -> Target:
    """The target at a share of the line; loads and extra axes change along it."""
    assert start.tip_m is not None
    assert end.tip_m is not None
    direction, mid_m = end.direction, end.mid_m
    if start.direction is not None and direction is not None:
        direction = turned(start.direction, direction, share)
    if start.mid_m is not None and mid_m is not None:
        mid_m = between(start.mid_m, mid_m, share)
    extra = end.extra and {
        name: start.extra[name] + share * (value - start.extra[name]) for name, value in end.extra.items()
    }
    # Written out: `replace` costs three times as much, and a row that jumps asks for eight of every robot.
    return Target(
        between(start.tip_m, end.tip_m, share), direction, mid_m, end.actuation,
        between(start.load_n, end.load_n, share), extra, end.measured_tip_m, end.measured_direction,
        end.rotation, end.arcs,
    )  # fmt: skip


def tip_line(config: RobotConfig, start: Target, end: Target, command: Actuation) -> TipLine | None:
    """The line from a target that the robot rests on to another one of its kind.

    None for targets without a tip, for whole frames, few of which are in reach between two, and where the
    model has no answer on the line, or answers that make it slow: then the axes go together to the answer.
    """
    if start.tip_m is None or end.tip_m is None or end.rotation is not None:
        return None
    answers, seed = [command], command
    for k in range(1, POINTS):
        target = config.frame.target_in_base(point(start, end, k / (POINTS - 1)))
        solution = config.model.inverse(target, seed)
        if not solution.converged:
            return None
        seed = solution.actuation
        answers.append(seed)
    velocity, acceleration, jerk = _rates(config, answers)
    if not velocity > 0.0:
        return None
    line = TipLine(start, end, Approach([0.0], [0.0], [1.0], [velocity], [acceleration], [jerk]))
    if config.motion_rules > 7:
        answer = config.model.inverse(config.frame.target_in_base(end), command).actuation
        together = motion_to(config, command, PresentRates.at_rest(len(command)), answer)
        if line.duration_s > _SLOWER * together.duration_s:
            return None
    return line


def _rates(config: RobotConfig, answers: list[Actuation]) -> tuple[float, float, float]:
    """Greatest velocity, acceleration and jerk of the share, from the axes at equal shares; 0 at rest."""
    greatest = [_greatest(column) for column in zip(*answers, strict=True)]
    velocity = acceleration = jerk = float("inf")
    limits = list(zip(greatest, config.velocity, config.acceleration, config.jerk, strict=True))
    for (slope, bend, twist), v, a, j in limits:
        if slope > 0.0:
            velocity = min(velocity, _SPEED * v / slope)
        if bend > 0.0:
            velocity = min(velocity, (_CURVED * a / bend) ** 0.5)
        if twist > 0.0:
            velocity = min(velocity, (_TWISTED * j / twist) ** (1.0 / 3.0))
    if velocity == float("inf"):
        return 0.0, 0.0, 0.0
    for (slope, bend, _), _, a, j in limits:
        if slope > 0.0:
            acceleration = min(acceleration, (_REST - _CURVED) * a / slope)
            jerk = min(jerk, (_REST - _TWISTED - _BOTH) * j / slope)
        if bend > 0.0:
            acceleration = min(acceleration, _BOTH * j / (3.0 * bend * velocity))
    return velocity, acceleration, jerk


def _greatest(column: Sequence[float]) -> list[float]:
    """Greatest first, second and third difference quotient of the answers of one axis, by the share."""
    n, found = float(POINTS - 1), []
    for _ in range(3):
        column = [n * (b - a) for a, b in pairwise(column)]
        found.append(max(map(abs, column)))
    return found
