"""What the regulators of an arm reported around a time, and the sides of their hysteresis.

The side of an axis is that of a play operator: a follower stays where it is while the command is within half
the loop of it, and else keeps that distance,

    follower := min(max(follower, command - half), command + half),   side = (command - follower) / half
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid_fit.identified_arm import Numbers
from contid_fit.sense.play import ON_BRANCH

#: Half the time over which the reports of regulators around a capture are averaged.
AVERAGED_S: Final = 0.01
#: Oldest measurement that still finds the pressures of its capture.
OLDEST_S: Final = 0.6
#: From this time after the last change of a command on, the pressures of an arm are constant.
RESTING_S: Final = 0.3
#: Bound of the delay of the reported pressures of a moving arm against its measured tip.
TIMING_S: Final = 0.003


@dataclass(frozen=True, slots=True)
class PressurePose:
    """Where an arm was at a capture.

    Attributes:
        pressures: reported [bar].
        sides: place of every axis between the branches of its hysteresis loop, -1 to 1.
        late: possible error of the pressures by the error of their time [bar]; 0 for an arm that rests.
        side_open: 1 where the axis has not yet moved through its loop, so that its side is unknown; else 0.

    Whether the arm rests and which sides are open is judged at the newest tick, not at the capture. For a
    capture before the end of a motion, or before an axis reached a branch, they are those of after it.
    """

    pressures: Numbers
    sides: Numbers
    late: Numbers
    side_open: Numbers


class PressureTrace:
    """Reports and sides of the newest ticks.

    Args:
        half_loop: half the play of every axis [bar], each above 0, as those of `IdentifiedArm` are: they are
            at least a part of the range of the axis.
        period_s: period of the tick.
    """

    def __init__(self, half_loop: Sequence[float], period_s: float) -> None:
        self._half_loop = half_loop
        self._period_s = period_s
        kept = max(2, round(OLDEST_S / period_s))
        self._reports: deque[tuple[Numbers | None, Numbers]] = deque(maxlen=kept)
        self._now_s = 0.0
        self._rested_s = 0.0
        self._commands: Numbers = ()
        self._sides: Numbers = ()
        self._follower: list[float] = []
        self._side_known: list[bool] = []

    def tick(self, now_s: float, reported_bar: Numbers | None, commands_bar: Numbers | None) -> None:
        """The reports [bar] and the commands of the tick before; None without."""
        self._now_s = now_s
        self._follow(commands_bar)
        self._reports.append((reported_bar, self._sides))

    def _follow(self, commands: Numbers | None) -> None:
        """Sides of the hysteresis from the commands; reports would drag them with their noise."""
        self._rested_s += self._period_s
        if commands is None or commands == self._commands:
            return
        self._rested_s, self._commands = 0.0, commands
        half_loop = self._half_loop
        if not self._follower:
            self._follower, self._side_known = list(commands), [False] * len(commands)
        self._follower = [
            min(max(held, p - loop), p + loop)
            for held, p, loop in zip(self._follower, commands, half_loop, strict=True)
        ]
        self._sides = tuple(
            [
                min(max((p - held) / loop, -1.0), 1.0)
                for p, held, loop in zip(commands, self._follower, half_loop, strict=True)
            ]
        )
        self._side_known = [
            known or abs(side) > ON_BRANCH for known, side in zip(self._side_known, self._sides, strict=True)
        ]

    def at(self, capture_s: float) -> PressurePose | None:
        """What the regulators reported around a time; None without reports.

        Reports are averaged whose pressures were measured within `AVERAGED_S` of the capture, and at least
        within half a tick, so that slow ticks have one.
        """
        # The newest report, at the end of the queue, was measured one tick ago; one place is one tick.
        newest = len(self._reports) - 1
        behind = (self._now_s - self._period_s - capture_s) / self._period_s
        half = max(AVERAGED_S / self._period_s, 0.5)
        first = max(0, math.ceil(newest - behind - half))
        last = min(newest, math.floor(newest - behind + half))
        around = [self._reports[i] for i in range(first, last + 1)]
        valid = [reported for reported, _ in around if reported is not None]
        sides = around[len(around) // 2][1] if around else ()
        if not valid or not sides:
            return None
        pressures = tuple([sum(column) / len(valid) for column in zip(*valid, strict=True)])
        # The error of the time by the velocity of the pressures: their change over the span of the reports,
        # which counts the valid ones as if none between them were missing.
        span_s = (len(valid) - 1) * self._period_s
        share = TIMING_S / span_s if span_s and self._rested_s < RESTING_S else 0.0
        return PressurePose(
            pressures=pressures,
            sides=sides,
            late=tuple([share * (new - old) for old, new in zip(valid[0], valid[-1], strict=True)]),
            side_open=tuple([0.0 if known else 1.0 for known in self._side_known]),
        )
