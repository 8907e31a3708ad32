"""Gives a refusal the number of the order that it answers."""

from __future__ import annotations

from dataclasses import replace

from contid.control.engine.cycle import Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import OrderRefused


class NumberedRefusals:
    """A sink before another one; what a robot refuses by itself, beside the orders, has no number.

    Attributes:
        order: number of the order that is carried out now, 0 for none.
    """

    def __init__(self, sink: Sink) -> None:
        self.order = 0
        self._sink = sink

    def write(self, values: list[float]) -> None:
        """See `Sink.write`."""
        self._sink.write(values)

    def event(self, event: RunEvent) -> None:
        """See `Sink.event`."""
        if self.order and isinstance(event, OrderRefused):
            event = replace(event, answers=self.order)
        self._sink.event(event)
