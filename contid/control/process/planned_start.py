"""A start at a time: the control process turns it into an order at a tick, which a recording holds."""

from __future__ import annotations

from typing import Final

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Sink
from contid.control.engine.events.orders import OrderRefused

#: Orders that cancel a planned start.
CANCELLING: Final = (msg.Hold, msg.Stop, msg.Estop, msg.Goto, msg.Rows, msg.Play, msg.Begin, msg.Finish)


class PlannedStart:
    """The start that is planned, if any.

    The trajectory begins in the tick whose deadline is nearest to the planned time: at most half a period
    away, unless ticks were skipped there. Times are on CLOCK_MONOTONIC [s].
    """

    def __init__(self, period_s: float) -> None:
        self._half_s = 0.5 * period_s
        self._at_s: float | None = None

    def plan(self, start: msg.Start, deadline_s: float, sink: Sink) -> None:
        """Plan a start; one whose time has passed at the deadline of this tick is refused."""
        if start.at_s + self._half_s < deadline_s:
            late_ms = (deadline_s - start.at_s) * 1e3
            message = f"the start came {late_ms:.1f} ms after its time; nothing began"
            sink.event(OrderRefused(message=message))
        else:
            self._at_s = start.at_s

    def cancel_for(self, message: object) -> None:
        """Cancel the planned start if the message is an order that moves or stops robots."""
        if isinstance(message, CANCELLING):
            self._at_s = None

    def due(self, deadline_s: float, start_s: float) -> msg.Go | None:
        """The order for the tick of a deadline that started at ``start_s``; None before the time."""
        if self._at_s is None or deadline_s + self._half_s < self._at_s:
            return None
        at_s, self._at_s = self._at_s, None
        return msg.Go(at_s, start_s)
