"""The rule that the measured axes follow their commands, from the records of a session alone.

An axis must be measured among the commands of the time that its response takes (its dead time and four
lags), or come nearer to them. Only that response is shared with the watch of the tick
(`contid.control.engine.watch`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Final

from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig

#: Lags within which an axis has followed.
_LAGS: Final = 4.0
#: Time that an axis may be away from all of these commands.
_AWAY_S: Final = 0.1


class FollowCheck:
    """The measured axes of one robot."""

    def __init__(self, config: RobotConfig) -> None:
        self._config = config
        self._ticks = [
            max(math.ceil((each.delay_s + _LAGS * each.lag_s) / config.period_s), 1)
            for each in config.responses
        ]
        self._most = max(math.ceil(_AWAY_S / config.period_s), 2)
        #: To which the effort of its devices is limited.
        self.effort_share = 1.0
        self.forget()

    def forget(self) -> None:
        """Records are missing, or nothing is commanded."""
        self._past: list[deque[float]] = [deque(maxlen=ticks) for ticks in self._ticks]
        self._away = [0] * len(self._ticks)
        self._before = [math.inf] * len(self._ticks)

    def tick(self, robot: RobotRecord, yields: bool) -> Iterator[str]:
        """Axes that were away for too long by now, once for each time.

        Args:
            robot: its record.
            yields: it closes on an object, which may hold it.
        """
        if yields or any(math.isnan(axis.device) for axis in robot.axes):
            self.forget()
            return
        for k, (axis, response) in enumerate(zip(robot.axes, self._config.responses, strict=True)):
            past = self._past[k]
            past.append(axis.device)
            if not axis.valid or math.isnan(axis.value):
                continue
            far = max(axis.value - max(past), min(past) - axis.value, 0.0)
            nearer = self._before[k] - far > 0.5 * response.top * self._config.period_s
            self._before[k] = far
            effort = None if math.isnan(axis.effort) else axis.effort
            held = response.holds(axis.device - axis.value, effort, self.effort_share)
            if far <= response.tolerance or nearer or held:
                self._away[k] = 0
                continue
            self._away[k] += 1
            if self._away[k] == self._most:
                quantity = self._config.quantities[k]
                off = quantity.from_si(far * response.unit)
                yield (
                    f"{self._config.axes[k]} was for {_AWAY_S:g} s {off:.3g} {quantity.unit} and more from "
                    "where its commands should have brought it"
                )
