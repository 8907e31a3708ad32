"""The clock of a server against `time.monotonic` of this machine.

An echo gives an interval: the server's time of the answer lies between sending and reception here. Of all
echoes the one counts whose half interval, widened with its age by the drift of two clocks, is smallest (F.
Cristian, "Probabilistic clock synchronization", Distributed Computing 3, 1989). Without echoes the frame
with the least latency counts as if it had none.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

#: Two clocks drift apart by no more than this [s/s].
DRIFT: Final = 1e-4
#: An echo this far outside the interval of the last shows that the server has started again [s].
RESTARTED_S: Final = 0.05
#: Longest round trip that counts [s].
MAX_ROUND_TRIP_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class ClockFix:
    """One comparison of the clocks.

    Attributes:
        offset_s: local time minus server time.
        at_s: local time of the comparison.
        bound_s: the offset was within this of it.
    """

    offset_s: float
    at_s: float
    bound_s: float

    def bound_at(self, now_s: float) -> float:
        """The bound at another time."""
        return self.bound_s + DRIFT * abs(now_s - self.at_s)


class EchoClock:
    """Offset of a server's clock from echoes."""

    def __init__(self) -> None:
        self.fix: ClockFix | None = None

    def echoed(self, sent_s: float, received_s: float, server_s: float) -> None:
        """Take an echo.

        Args:
            sent_s: local time of the request.
            received_s: local time of the answer.
            server_s: time of the server in the answer.
        """
        half_s = 0.5 * (received_s - sent_s)
        if not 0.0 <= half_s <= 0.5 * MAX_ROUND_TRIP_S:
            return
        new = ClockFix(0.5 * (sent_s + received_s) - server_s, received_s, half_s)
        old = self.fix
        if old is not None:
            apart_s = abs(new.offset_s - old.offset_s) - new.bound_s - old.bound_at(received_s)
            if apart_s <= RESTARTED_S and old.bound_at(received_s) < new.bound_s:
                return
        self.fix = new

    def local_s(self, server_s: float) -> float:
        """Local time of a time of the server; NaN before the first echo."""
        return math.nan if self.fix is None else server_s + self.fix.offset_s

    def bound_s(self, now_s: float) -> float:
        """How far the offset may be off now; infinite before the first echo."""
        return math.inf if self.fix is None else self.fix.bound_at(now_s)


class LeastLatency:
    """Offset of a clock from messages that carry its time: the least latency of a window counts as none.

    Args:
        window_s: messages that are compared.
    """

    def __init__(self, window_s: float = 10.0) -> None:
        self._window_s = window_s
        #: Arrivals and differences, rising: the first is the least.
        self._least: deque[tuple[float, float]] = deque()

    def local_s(self, server_s: float, received_s: float) -> float:
        """Local time at which a message was sent; never later than its arrival."""
        offset_s = received_s - server_s
        while self._least and self._least[-1][1] >= offset_s:
            self._least.pop()
        self._least.append((received_s, offset_s))
        while self._least[0][0] < received_s - self._window_s:
            self._least.popleft()
        return server_s + self._least[0][1]

    def clear(self) -> None:
        """Forget everything."""
        self._least.clear()
