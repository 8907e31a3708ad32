"""Orders that stop: every client may give them, and they are sent before anything else is checked."""

from __future__ import annotations

import asyncio

from contid.control.engine.messages import Estop, Hold, Stop
from contid.remote.protocol.wire import ESTOP, Fields, RemoteError, RequestFields, decode
from contid.remote.server.lease import client_label
from contid.remote.server.pending_orders import OrderResult
from contid.remote.server.query_handler import Caller, Verb
from contid.remote.server.served_run import ServedRun


class StopOrders:
    """The verbs ``hold``, ``stop`` and ``estop``, and stops without a response."""

    def __init__(self, run: ServedRun) -> None:
        self._run = run
        self._ended = False

    @property
    def verbs(self) -> dict[str, Verb]:
        """Method of each verb."""
        return {Hold.NAME: self._hold, Stop.NAME: self._stop, Estop.NAME: self._estop}

    async def _hold(self, caller: Caller, request: RequestFields) -> Fields:
        robots = self._run.robots_of(request)
        request.end()
        return await self._halt(caller, robots, Hold(robots))

    async def _estop(self, caller: Caller, request: RequestFields) -> Fields:
        try:
            robots = self._run.robots_of(request)
            request.end()
        except RemoteError as error:
            raise await self.obey_malformed_estop(caller, error) from None
        return await self._halt(caller, robots, Estop(robots))

    def estop_all(self, caller: Caller) -> None:
        """Stop all robots for a client that gets no response any more."""
        self._send_stop(caller, Estop())

    def estop_before_turn(self, caller: Caller, line: bytes) -> None:
        """Send the emergency stop of a line that has just arrived: of the robots it names, else of all."""
        try:
            fields = decode(line)
            request = RequestFields(fields)
            robots = self._run.robots_of(request) if fields.get("verb") == ESTOP else None
            request.end()
        except RemoteError:
            robots = None
        self._send_stop(caller, Estop(robots))

    async def obey_malformed_estop(self, caller: Caller, error: RemoteError) -> RemoteError:
        """Stop all robots for an estop with a mistake; returns the refusal to send."""
        await self._halt(caller, None, Estop())
        return RemoteError(error.code, f"{error}; all robots were stopped")

    async def _stop(self, caller: Caller, request: RequestFields) -> Fields:
        robots, ends = self._run.robots_of(request), request.flag("end")
        request.end()
        if ends and not self._ended:
            self._ended = True
            self._run.control.interrupt()
        return await self._halt(caller, robots, Stop(robots))

    async def _halt(
        self, caller: Caller, robots: tuple[str, ...] | None, order: Hold | Stop | Estop
    ) -> Fields:
        return await self._run.confirmed(self._send_stop(caller, order), robots, stops=True)

    def _send_stop(self, caller: Caller, order: Hold | Stop | Estop) -> asyncio.Future[OrderResult]:
        """Send an order to stop at once; then the lease and the streams."""
        future = self._run.pending.send([order])
        message = f"{client_label(caller.name, caller.by)} ({order.NAME})"
        holder = self._run.lease.stop(caller.number, message)
        if holder is not None:
            self._run.notify(
                holder.client, {"event": "lease-lost", "message": f"{message} stopped the robots"}
            )
        self._run.moves.stop(message)
        return future
