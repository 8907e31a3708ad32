"""Until when an order by network may arm or move: a second after it came, and never after a standstill.

The clocks of operators are not those of the machine, so an order is dated when the bridge takes it. One that
came while the bridge stood still is taken when it goes on; so orders that are taken right after a standstill
are refused. Orders to stop, and what only reads, are always taken.
"""

from __future__ import annotations

from typing import Final

from contid.remote.protocol import expiry

#: How long an order may take from the bridge to the begin of its work in the daemon [s].
VALID_S: Final = 1.0
#: Orders that are taken this long after a standstill may have waited meanwhile [s].
WAITED_S: Final = 0.5


class OrderTimes:
    """When this process ran, and until when the orders that it takes are valid."""

    def __init__(self) -> None:
        self._looked_s = expiry.clock_s()
        self._waited_until_s = 0.0

    def look(self) -> None:
        """Look at the clock; called every `contid.remote.protocol.expiry.LOOK_S`, in any thread."""
        before_s, self._looked_s = self._looked_s, expiry.clock_s()
        if self._looked_s - before_s > expiry.STOOD_S:
            self._waited_until_s = self._looked_s + WAITED_S

    def until_s(self) -> float:
        """Until when an order is valid that is taken now; a past time where it may have waited."""
        self.look()
        return self._looked_s + (VALID_S if self._looked_s >= self._waited_until_s else -expiry.STOOD_S)
