"""Input shaping: commands go out in parts, half a period apart, so that the body does not swing on.

A command that goes out as a share now and the rest half a period later starts two swings that cancel (N. C.
Singer and W. P. Seering, "Preshaping Command Inputs to Reduce System Vibration", J. Dyn. Sys. Meas. Control
112, 1990). With ``K = exp(-z pi / sqrt(1 - z^2))`` for the damping ratio z, the shares are

    zv:   1, K            over 1 + K,            at 0, T/2
    zvd:  1, 2 K, K^2     over (1 + K)^2,        at 0, T/2, T

for the damped period T. Zvd also cancels, to the first order, what an error of the frequency leaves. Delays
between two ticks are divided among them. With a schedule over poses zvd is the product of the zv of the two
slowest modes.

What goes out is a weighted mean of the commands of the last period: it is within every limit of position,
speed, acceleration and jerk that those keep, and within every convex limit that axes share. For that the
weights stay the same until the last command is out: they are chosen when the next motion begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import mul
from typing import Final

from contid.robot_file.base import Quantity
from contid.robot_file.rates import InputShape
from contid.targets import ZERO3, Actuation, Vec3


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
    def of(cls, shape: InputShape, period_s: float, frequencies: tuple[float, float] | None = None) -> Shaper:
        """The shaper for the ``shape`` of a robot file.

        Args:
            shape: rates.shape of the file.
            period_s: period of the tick.
            frequencies: those of the two slowest modes [Hz]; None for the one frequency of the file.
        """
        found: dict[int, float] = {}
        impulses = shape.impulses(frequencies)
        whole = sum(size for _, size in impulses)
        for after_s, size in impulses:
            ticks = after_s / period_s
            age = math.floor(ticks)
            rest = ticks - age
            for at, part in ((age, 1.0 - rest), (age + 1, rest)):
                if part > 0.0:
                    found[at] = found.get(at, 0.0) + size * part / whole
        ages = tuple(sorted(found))
        return cls(ages, tuple(found[age] for age in ages))


@dataclass(frozen=True, slots=True)
class ShaperChoice:
    """Which shaper a motion has.

    Attributes:
        shape: rates.shape of the robot file.
        quantity: quantity of the axes of the model, in whose unit a schedule has poses.
        period_s: period of the tick.
        fixed: the shaper of every motion where the shape has no schedule.
    """

    shape: InputShape
    quantity: Quantity
    period_s: float
    fixed: Shaper

    @classmethod
    def of(cls, shape: InputShape, quantity: Quantity, period_s: float) -> ShaperChoice:
        """The choice for the ``shape`` of a robot file, as in the attributes."""
        return cls(shape, quantity, period_s, Shaper.of(shape, period_s))

    def shaper(self, pose: Actuation, load_n: Vec3) -> Shaper:
        """The shaper of a motion.

        Args:
            pose: where the body has the frequencies that count [m or Pa]; extra axes are not used.
            load_n: known force on the tip.
        """
        schedule = self.shape.schedule
        if schedule is None:
            return self.fixed
        values = [self.quantity.from_si(value) for value in pose[: len(schedule.middle)]]
        return Shaper.of(self.shape, self.period_s, schedule.frequencies(values, math.hypot(*load_n)))


@dataclass(frozen=True, slots=True)
class Shaped:
    """The state of shaping after a tick: the commands of the last period, and what goes to the devices.

    Attributes:
        past: commands of the present motion, the oldest first; empty at rest.
        acting: their weighted mean, which goes out; empty before the first command.
        ticks_left: ticks until `acting` is the last command, if no other follows.
        shaper: shaper of the present motion, None at rest.
    """

    past: tuple[Actuation, ...] = ()
    acting: Actuation = ()
    ticks_left: int = 0
    shaper: Shaper | None = None


#: Before the first command.
NOT_SHAPED: Final = Shaped()


def next_shaped(
    choose: Callable[[Actuation, Vec3], Shaper],
    before: Shaped,
    last: Actuation,
    command: Actuation,
    goal: Actuation,
    load_n: Vec3 = ZERO3,
) -> Shaped:
    """The state after a tick, with what goes out in it.

    Args:
        choose: the shaper of a motion to a pose under a load (`ShaperChoice.shaper`).
        before: the state after the tick before.
        last: the command of the tick before.
        command: the command of this tick.
        goal: where the motion goes, as far as that is known.
        load_n: known force on the tip.
    """
    if command == last and before.ticks_left <= 1:  # at rest, or its last part goes out now
        return Shaped((), command, 0)
    shaper = choose(goal, load_n) if before.shaper is None else before.shaper
    longest = shaper.ages[-1]
    left = longest if command != last else before.ticks_left - 1
    past = ((*before.past, command) if before.past else (*(last,) * longest, command))[-longest - 1 :]
    return Shaped(past, _mean(shaper, past), left, shaper)


def _mean(shaper: Shaper, past: Sequence[Actuation]) -> Actuation:
    chosen = [past[-1 - age] for age in shaper.ages]
    return tuple([sum(map(mul, shaper.weights, values)) for values in zip(*chosen, strict=True)])
