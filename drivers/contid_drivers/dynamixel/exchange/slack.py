"""Extra waiting time of an exchange in which nothing arrived: a stall of the host, not a silent servo."""

from __future__ import annotations

from typing import Final, Literal

#: A scheduler tick of a kernel at 250 Hz: a process may get its bytes this much later.
SLACK_MIN_S: Final = 4.2e-3
SLACK_MAX_S: Final = 20e-3
#: Exchanges per window; its second largest lateness is the 99.9th percentile.
WINDOW: Final = 1000
#: Factor on the measured percentile: larger latenesses are rare, but not much larger.
MARGIN: Final = 1.5


class Slack:
    """The slack of one bus, fixed or from the lateness of the answers so far.

    Args:
        slack_ms: of the robot file.
    """

    def __init__(self, slack_ms: float | Literal["auto"]) -> None:
        self._slack_ms = slack_ms
        self._count = 0
        #: The two largest latenesses of this window, and the second largest of the window before [s].
        self._largest = self._second = self._before = 0.0

    def record(self, late_s: float) -> None:
        """Count an exchange whose last answer came ``late_s`` after its time on the wire."""
        if late_s > self._second:
            self._largest, self._second = max(self._largest, late_s), min(self._largest, late_s)
        self._count += 1
        if self._count >= WINDOW:
            self._count, self._before = 0, self._second
            self._largest = self._second = 0.0

    @property
    def percentile_s(self) -> float:
        """99.9th percentile of the lateness in this window and the one before."""
        return max(self._second, self._before)

    @property
    def seconds(self) -> float:
        """Time to wait beyond the time-out [s]."""
        if self._slack_ms != "auto":
            return self._slack_ms / 1e3
        return min(max(MARGIN * self.percentile_s, SLACK_MIN_S), SLACK_MAX_S)
