"""What the regulators of an arm reported around a time, and the sides of their hysteresis."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid.kinematics.cosserat.identified_arm import Numbers

#: Half the time over which the reports of regulators around a capture are averaged.
AVERAGED_S: Final = 0.01
#: Oldest measurement that still finds the pressures of its capture.
OLDEST_S: Final = 0.6
#: From this time after the last change of a command on, the pressures of an arm are constant.
RESTING_S: Final = 0.3
#: Bound of the delay of the reported pressures of a moving arm against its measured tip.
TIMING_S: Final = 0.003
#: From this absolute value of its side on, an axis counts as on a branch of its hysteresis loop.
_ON_BRANCH: Final = 0.999


@dataclass(frozen=True, slots=True)
class PressurePose:
    """Where an arm was at a capture.

    Attributes:
        pressures: reported [bar].
        sides: place of every axis between the branches of its hysteresis loop, -1 to 1.
        late: possible error of the pressures by the error of their time [bar].
        side_open: 1 where the axis has not yet moved through its loop, so that its side is unknown; else 0.
    """

    pressures: Numbers
    sides: Numbers
    late: Numbers
    side_open: Numbers


class PressureTrace:
    """Reports and sides of the newest ticks.

    Args:
        half_loop: half the play of every axis [bar].
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
            known or abs(side) > _ON_BRANCH for known, side in zip(self._side_known, self._sides, strict=True)
        ]

    def at(self, capture_s: float) -> PressurePose | None:
        """What the regulators reported around a time; None without reports."""
        # The newest report was read one tick ago.
        behind = (self._now_s - self._period_s - capture_s) / self._period_s
        half = max(AVERAGED_S / self._period_s, 0.5)
        count = len(self._reports)
        first = max(0, math.ceil(count - 1 - behind - half))
        last = min(count - 1, math.floor(count - 1 - behind + half))
        reports = [self._reports[i] for i in range(first, last + 1)]
        known = [each for each, _ in reports if each is not None]
        sides = reports[len(reports) // 2][1] if reports else ()
        if not known or not sides:
            return None
        pressures = tuple([sum(column) / len(known) for column in zip(*known, strict=True)])
        span_s = (len(known) - 1) * self._period_s
        share = TIMING_S / span_s if span_s and self._rested_s < RESTING_S else 0.0
        return PressurePose(
            pressures,
            sides,
            tuple([share * (new - old) for old, new in zip(known[0], known[-1], strict=True)]),
            tuple([0.0 if known else 1.0 for known in self._side_known]),
        )
