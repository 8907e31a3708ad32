"""The clock of a board on the clock of the host.

    host time = board time + offset

The board composes an answer after the host began to send the request and before it has the answer. So every
exchange bounds the offset from both sides. The bounds are kept, widened by the drift of the two crystals, and
their middle is the estimate: its error is at most half of the shortest recent round trip.
"""

from __future__ import annotations

import math
from typing import Final

#: Bound of the drift of two crystals against each other, with their temperature (30 to 50 ppm each).
DRIFT: Final = 100e-6
#: Least time between two samples: a better estimate of the offset might place a tick before the last one.
STEP_S: Final = 1e-6
_WRAP_MS: Final = 1 << 32


class BoardClock:
    """Maps board times to host times; starts anew when its bounds contradict each other.

    Attributes:
        sampled_s: host time of the tick of the newest answer; later with every answer, also of the same tick.
    """

    def __init__(self) -> None:
        self._uptime_ms = self._total_ms = 0
        self._low_s, self._high_s = -math.inf, math.inf
        self._at_s = 0.0
        self.sampled_s = -math.inf

    def update(self, uptime_ms: int, age_us: int, asked_s: float, received_s: float) -> None:
        """Use an answer.

        Args:
            uptime_ms: tick of the board whose inputs it holds; wraps after 49 days.
            age_us: time from that tick to the answer.
            asked_s: host time before the request was sent.
            received_s: host time after the answer was received.
        """
        self._total_ms += (uptime_ms - self._uptime_ms) % _WRAP_MS
        self._uptime_ms = uptime_ms
        composed_s = self._total_ms / 1e3 + age_us / 1e6
        drift_s, self._at_s = DRIFT * abs(received_s - self._at_s), received_s
        low_s, high_s = asked_s - composed_s, received_s - composed_s
        self._low_s, self._high_s = max(low_s, self._low_s - drift_s), min(high_s, self._high_s + drift_s)
        if self._low_s > self._high_s:
            self._low_s, self._high_s = low_s, high_s
        sampled_s = self._total_ms / 1e3 + (self._low_s + self._high_s) / 2.0
        self.sampled_s = max(sampled_s, self.sampled_s + STEP_S)
