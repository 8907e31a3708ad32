"""Results of orders: the tick that obeyed, the states after it, and the robots that refused."""

from __future__ import annotations

import asyncio

from contid.control.daemon.interfaces import RunControl
from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.remote.server.pending_orders import OrderResult, PendingOrders
from contid.remote.server.telemetry_view import TelemetryView


class OrderResults:
    """Waits for orders and reads the states of robots after them."""

    def __init__(self, control: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._control = control
        self._view = view
        self._pending = pending

    async def confirmed(self, future: asyncio.Future[OrderResult], robots: tuple[str, ...] | None) -> Fields:
        """The result of an order: the tick that obeyed it, the states after it, and who refused it.

        Raises:
            RemoteError: every robot refused.
        """
        outcome = await self._pending.confirmed(future)
        result: Fields = {"tick": outcome.tick, "robots": self.states(robots)}
        if not outcome.refused:
            return result
        if outcome.refused.keys() >= result["robots"].keys() or "" in outcome.refused:
            faults = self._view.faults(self._control.newest(), robots)
            raise RemoteError(Code.REFUSED, "; ".join(outcome.refused.values()), faults)
        return {**result, "refused": dict(outcome.refused)}

    def states(self, robots: tuple[str, ...] | None) -> Fields:
        """State by robot now."""
        record = self._control.newest()
        names = robots if robots is not None else tuple(self._view.configs)
        return {name: self._view.mode(name, record).name for name in names}
