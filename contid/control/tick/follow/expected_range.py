"""Where an axis can be that obeys its commands: the range between the quickest and the slowest device.

A device answers a command after a dead time of at most ``d`` and with a first-order lag of at most ``tau``.
From the commands ``c`` alone follow an upper and a lower bound, with ``up`` and ``down`` the greatest and the
least command of the last ``d``:

    hi' = (up - hi) / tau   while hi > up, else hi = up          lo' = (down - lo) / tau   while lo < down

Every axis with less dead time and less lag stays between them, because at the upper bound its speed
``(c(t - d) - hi) / tau`` is at most that of the bound, and at the lower one at least. A device that limits
its speed itself has bounds that are no faster. So a quick axis is never outside, and a slow one is as soon
as it is slower than the worst that counts as healthy. Where a least dead time and a least lag are known
too, ``up`` and ``down`` leave out the commands of the least dead time, and a bound that moves outwards does
so with the least lag in place of at once. A reversal within the dead time counts by its ends; its bulge is
at most ``a d^2 / 8`` for an acceleration ``a``. Ticks that were skipped only widen the range.
For a device that overshoots, the bounds run ahead of the command by a time at its speed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

#: Lags that a range looks back at when it begins in the midst of a motion; the rest is 5 %.
_LOOK_BACK: Final = 3.0
#: Measurements that are older than the first are compared with all commands of their time, up to the second,
#: from which on they are another fault (`contid.control.tick.faults.Fault.AXIS_STALE`) [s].
OLD_S: Final = 0.02
OLDEST_S: Final = 0.1
#: Rounding of a time that is whole periods.
_EXACT: Final = 1e-9


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """How an axis answers its commands when it is healthy; all in the unit of its device [rad or Pa].

    Attributes:
        tolerance: greatest distance from the range that is healthy.
        delay_s: longest dead time, with that of bus and adapter [s].
        lag_s: greatest time constant [s].
        top: greatest speed where the device limits it itself, else infinite [1/s].
        jump: greatest change between two ticks that a body is capable of.
        overshoot_s: how far the device may run ahead, as a time at the speed of its command [s].
        pushing_a: effort from which on a device pushes on something and may yield to it [A]; 0 where that is
            not known, infinite for one that does not yield.
        least_delay_s, least_lag_s: shortest dead time and lag; 0 where they are not identified [s].
        unit: the tolerance's size in m, Pa or rad of the axis divided by that of the device.
    """

    tolerance: float
    delay_s: float
    lag_s: float
    top: float
    jump: float
    overshoot_s: float = 0.0
    unit: float = 1.0
    least_delay_s: float = 0.0
    least_lag_s: float = 0.0
    pushing_a: float = math.inf

    def holds(self, way: float, effort: float | None, share: float) -> bool:
        """True for a device that pushes on something and may yield to it: it may be anywhere.

        Args:
            way: command less measurement; one that pushes does so towards its command.
            effort: as measured [A]; where it is not, every device that yields counts as one that pushes.
            share: to which its effort is limited now.
        """
        if effort is None or self.pushing_a == 0.0:
            return self.pushing_a < math.inf
        return math.copysign(effort, effort * way) >= share * self.pushing_a


class ExpectedRange:
    """The range of every axis of one robot, kept up by its commands.

    Attributes:
        lows, highs: the bounds [rad or Pa].
        past: newest commands; one of a tick in which the bounds are not needed is appended here.
    """

    def __init__(self, responses: Sequence[AxisResponse], period_s: float) -> None:
        delays = [max(math.ceil(each.delay_s / period_s - _EXACT), 1) for each in responses]
        lag_s = max(each.lag_s for each in responses)
        self._period_s = period_s
        self._look_back = max(delays) + math.ceil(_LOOK_BACK * lag_s / period_s) + 1
        self.past: deque[tuple[float, ...]] = deque(maxlen=self._look_back + math.ceil(OLDEST_S / period_s))
        #: Per axis: greatest and least dead time in periods; what each lag leaves of a distance in a period;
        #: greatest change in a period; how many periods it runs ahead.
        self._rates = [
            (
                delay,
                min(int(each.least_delay_s / period_s + _EXACT), delay),
                math.exp(-period_s / each.lag_s),
                math.exp(-period_s / each.least_lag_s) if each.least_lag_s else 0.0,
                each.top * period_s,
                each.overshoot_s / period_s,
            )
            for delay, each in zip(delays, responses, strict=True)
        ]
        self.lows: list[float] = []
        self.highs: list[float] = []

    def begin(self, device: tuple[float, ...], values: Sequence[float]) -> None:
        """The first command, to axes that are at ``values``."""
        self.past.clear()
        self.past.append(device)
        self.lows = [min(pair) for pair in zip(device, values, strict=True)]
        self.highs = [max(pair) for pair in zip(device, values, strict=True)]

    def catch_up(self) -> None:
        """Bounds from the commands noted so far; wider than those of `advance`, and as wide soon."""
        columns = list(zip(*list(self.past)[-self._look_back :], strict=True))
        ahead = [
            [b + (b - a) * lead for a, b in pairwise(column)]
            for column, (*_, lead) in zip(columns, self._rates, strict=True)
        ]
        self.lows = [min(*column, *more) for column, more in zip(columns, ahead, strict=True)]
        self.highs = [max(*column, *more) for column, more in zip(columns, ahead, strict=True)]

    def advance(self, device: tuple[float, ...]) -> None:
        """The bounds one period later, from which on a new command holds."""
        past, lows, highs = self.past, self.lows, self.highs
        past.append(device)
        newest = len(past) - 1
        for i, (delay, least_delay, keep, least_keep, most, lead) in enumerate(self._rates):
            # What the quickest device obeys now and obeyed one period before, and the slowest one now.
            now = past[max(newest - least_delay, 0)][i]
            before, slowest = past[max(newest - least_delay - 1, 0)][i], past[max(newest - delay, 0)][i]
            up, down = (before, slowest) if before > slowest else (slowest, before)
            high, low = highs[i], lows[i]
            ahead = now + (now - before) * lead
            above, below = max(up, now, ahead), min(down, now, ahead)
            # A bound comes back by the greatest lag, no faster than the device; it goes out by the least.
            highs[i] = max(up + (high - up) * keep, high - most, above + min(high - above, 0.0) * least_keep)
            lows[i] = min(down + (low - down) * keep, low + most, below + max(low - below, 0.0) * least_keep)

    def excess(self, axis: int, value: float, age_s: float = 0.0) -> float:
        """Distance of a measurement from the range of its axis, 0 inside.

        Args:
            axis: its number.
            value: what was measured.
            age_s: before now; an old one is compared with all commands that it may show.
        """
        high, low = self.highs[axis], self.lows[axis]
        if age_s > OLD_S:
            back = self._look_back + math.ceil(age_s / self._period_s)
            column = [each[axis] for each in list(self.past)[-back:]]
            high, low = max(high, *column), min(low, *column)
        return max(value - high, low - value, 0.0)

    def still(self, axis: int, width: float) -> bool:
        """True when the axis had time to follow its last motion up to ``width``."""
        return self.highs[axis] - self.lows[axis] <= width
