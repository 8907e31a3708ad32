"""What every order of a client needs: the run, its robots, its moves and its lease, and how orders end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.tick_layout import TickRecord
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.lease import Lease
from contid.remote.server.moves import Moves
from contid.remote.server.pending_orders import OrderResult, PendingOrders
from contid.remote.server.telemetry_view import TelemetryView


@dataclass(frozen=True, slots=True)
class ServedRun:
    """A run that clients give orders to.

    Attributes:
        control: of the run.
        view: its robots.
        pending: orders that are not confirmed.
        moves: in progress.
        lease: of its motion.
        notify: sends a notice to a client by number.
    """

    control: RunControl
    view: TelemetryView
    pending: PendingOrders
    moves: Moves
    lease: Lease
    notify: Callable[[int, Mapping[str, Any]], None]

    def robots_of(self, request: RequestFields) -> tuple[str, ...] | None:
        """The robots that an order is for, None for all.

        Raises:
            RemoteError: one is unknown, or the list is empty: a stop for no robot is a mistake.
        """
        robots = self.view.named(request)
        if robots == ():
            raise RemoteError(Code.BAD_REQUEST, "robots: the list is empty; without robots it is for all")
        return robots

    async def confirmed(
        self, future: asyncio.Future[OrderResult], robots: tuple[str, ...] | None, stops: bool = False
    ) -> Fields:
        """The result of an order: the tick that obeyed it, the states after it, and who refused it.

        Of a stop it has the robots of which a ``stronger`` one goes on instead.

        Args:
            future: of the order, from `PendingOrders.send`.
            robots: those that the order is for; None for all.
            stops: an order to stop: the result has the axes that were ``silent`` in that tick.

        Raises:
            RemoteError: every robot refused, or the order as a whole was refused.
        """
        outcome = await self.pending.confirmed(future)
        result: Fields = {"tick": outcome.tick, "robots": self.states(robots, outcome.record)}
        if stops and (silent := self.view.silent(robots, outcome.record)):
            result["silent"] = silent
        if outcome.stronger:
            result["stronger"] = dict(outcome.stronger)
        if not outcome.refused:
            return result
        as_a_whole = "" in outcome.refused  # an `OrderRefused` that names no robot
        if as_a_whole or outcome.refused.keys() >= result["robots"].keys():
            faults = self.view.faults(outcome.record, robots)
            raise RemoteError(Code.REFUSED, "; ".join(outcome.refused.values()), faults)
        return {**result, "refused": dict(outcome.refused)}

    def states(self, robots: tuple[str, ...] | None, record: TickRecord | None) -> Fields:
        """State by robot in a record; of all robots where ``robots`` is None."""
        names = robots if robots is not None else tuple(self.view.configs)
        return {name: self.view.mode(name, record).name for name in names}
