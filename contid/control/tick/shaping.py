"""Input shaping: commands go out in parts, half a period apart, so that the body does not swing on.

A command that goes out as a share now and the rest half a period later starts two swings that cancel (N. C.
Singer and W. P. Seering, "Preshaping Command Inputs to Reduce System Vibration", J. Dyn. Sys. Meas. Control
112, 1990). With ``K = exp(-z pi / sqrt(1 - z^2))`` for the damping ratio z, the shares are

    zv:   1, K            over 1 + K,            at 0, T/2
    zvd:  1, 2 K, K^2     over (1 + K)^2,        at 0, T/2, T

for the damped period T. Zvd also cancels the change by an error of the frequency. Delays between two ticks
are divided among them.

What goes out is a weighted mean of the commands of the last period: it is within every limit of position,
speed, acceleration and jerk that those keep, and within every convex limit that axes share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import mul
from typing import Final

from contid.robot_file.base import InputShape, ShapeKind
from contid.targets import Actuation


@dataclass(frozen=True, slots=True)
class Shaper:
    """Weights of commands by their age.

    Attributes:
        ages: in ticks, ascending.
        weights: positive, together 1.
    """

    ages: tuple[int, ...]
    weights: tuple[float, ...]

    @classmethod
    def of(cls, shape: InputShape, period_s: float) -> Shaper:
        """Of the ``shape`` of a robot file, for a period of the tick."""
        root = math.sqrt(1.0 - shape.damping_ratio**2)
        k = math.exp(-shape.damping_ratio * math.pi / root)
        shares = (1.0, k) if shape.kind is ShapeKind.ZV else (1.0, 2.0 * k, k * k)
        half_ticks = 0.5 / shape.frequency_hz / period_s
        found: dict[int, float] = {}
        for number, share in enumerate(shares):
            age = math.floor(number * half_ticks)
            rest = number * half_ticks - age
            for at, part in ((age, 1.0 - rest), (age + 1, rest)):
                if part > 0.0:
                    found[at] = found.get(at, 0.0) + share * part / sum(shares)
        ages = tuple(sorted(found))
        return cls(ages, tuple(found[age] for age in ages))


@dataclass(frozen=True, slots=True)
class Shaped:
    """The commands of the last period, and what goes to the devices.

    Attributes:
        past: commands, the oldest first.
        acting: the weighted mean; empty before the first command.
        ticks_left: until `acting` is the last command, if that stands.
    """

    past: tuple[Actuation, ...] = ()
    acting: Actuation = ()
    ticks_left: int = 0


NOT_SHAPED: Final = Shaped()


def next_shaped(shaper: Shaper, before: Shaped, last: Actuation, command: Actuation) -> Shaped:
    """What goes out after a tick.

    Args:
        shaper: of the robot.
        before: after the tick before.
        last: the command of the tick before.
        command: of this tick.
    """
    longest = shaper.ages[-1]
    if command != last:
        left = longest
    elif before.ticks_left <= 1:
        return Shaped((), command, 0)
    else:
        left = before.ticks_left - 1
    past = ((*before.past, command) if before.past else (*(last,) * longest, command))[-longest - 1 :]
    return Shaped(past, _mean(shaper, past), left)


def _mean(shaper: Shaper, past: Sequence[Actuation]) -> Actuation:
    chosen = [past[-1 - age] for age in shaper.ages]
    return tuple([sum(map(mul, shaper.weights, values)) for values in zip(*chosen, strict=True)])
