"""Requests of a client, one method per verb; those that only read: `contid.remote.server.query_handler`.

Everybody may read, and everybody may hold, stop and estop; those orders go out before anything else is looked
at. Moving needs the motion right (`contid.remote.server.lease`). A stop by somebody else takes the right
from its
holder, who has to take it again explicitly: a script in a loop does not undo the stop of a person. Measuring
needs no right to move, but every robot has one tracker at most (`contid.remote.server.trackers`).
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.messages import ClearFault, Estop, Hold, Message, Resume, Stop
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.lease import GREATEST_TIMEOUT_S, LEAST_TIMEOUT_S, TIMEOUT_S, Lease, LeaseHolder
from contid.remote.server.moves import Moves
from contid.remote.server.pending_orders import PATIENCE_S, PendingOrders
from contid.remote.server.query_handler import Caller, QueryHandler, Verb
from contid.remote.server.telemetry_view import TelemetryView
from contid.remote.server.trackers import Trackers


class RequestHandler:
    """The desk at which every client is served."""

    def __init__(
        self,
        orders: RunControl,
        tell: Callable[[int, Mapping[str, Any]], None],
        clients: Callable[[], int],
    ) -> None:
        """Serve a run; ``tell`` sends a notice to the client with a number, ``clients`` counts them."""
        self._orders = orders
        self._tell = tell
        self._ended = False
        self._refusals: dict[str, str] = {}
        self._busy: Counter[int] = Counter()
        self.picture = TelemetryView(orders.loaded, orders.rate_hz, orders.refresh)
        self.ledger = PendingOrders(orders.send)
        self.moves = Moves(orders, self.picture, self.ledger)
        self.trackers = Trackers(orders, self.picture)
        self.right = Lease(time.monotonic(), orders.input_active)
        self.reading = QueryHandler(orders, self.picture, self.right, self.trackers, clients)
        self._verbs: dict[str, Verb] = {
            **self.reading.verbs,
            "hold": self._hold, "stop": self._stop, "estop": self._estop,
            "take": self._take, "release": self._release, "resume": self._resume,
            "clear_fault": self._clear_fault, "move": self._move, "rows": self._rows, "end": self._end,
            "measure": self._measure,
        }  # fmt: skip

    async def serve(self, caller: Caller, fields: Mapping[str, Any]) -> Fields:
        """Carry out one request.

        Raises:
            RemoteError: it was refused.
        """
        verb = fields.get("verb")
        if not isinstance(verb, str) or verb not in self._verbs:
            message = f"unknown verb {str(verb)[:60]!r}; there are {', '.join(self._verbs)}"
            raise RemoteError(Code.UNKNOWN_VERB, message)
        self._busy[caller.number] += 1
        try:
            self.right.refresh(caller.number, time.monotonic())
            return await self._verbs[verb](caller, RequestFields(fields))
        finally:
            # Whoever waits for an answer is alive, however long it takes.
            self.right.refresh(caller.number, time.monotonic())
            self._busy[caller.number] -= 1
            if not self._busy[caller.number]:
                del self._busy[caller.number]

    def notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        kind = event["event"]
        if kind == "refused":
            self._refusals[str(event.get("robot", ""))] = str(event["message"])
        elif kind == "end" and self.right.input_holds:
            self.right.holder = None
        self.reading.notice(event)
        self.picture.notice(event)
        self.ledger.notice(event)
        self.moves.notice(event)

    @property
    def streaming(self) -> bool:
        """True while rows may be waited for, or measurements come."""
        return self.moves.open or self.trackers.active

    def watch(self) -> None:
        """What time alone brings about; called often."""
        now_s = time.monotonic()
        self.moves.refill()
        self.trackers.watch(now_s)
        holder = self.right.holder
        if holder is not None and holder.client in self._busy:
            return
        holder = self.right.expired(now_s)
        if holder is not None:
            self._lost(holder, f"no request for {holder.timeout_s:g} s")

    def gone(self, client: int) -> None:
        """A client is gone; if it had the motion right, its robots hold."""
        self.trackers.gone(client)
        holder = self.right.holder
        if holder is not None and holder.client == client:
            self.right.holder = None
            self._lost(holder, "its connection ended")

    def _lost(self, holder: LeaseHolder, message: str) -> None:
        self._orders.send(Hold())
        self.moves.abort_streams(message)
        self._orders.say(f"client {holder.name!r} lost the motion right ({message}); holding")
        self._tell(holder.client, {"event": "right", "lost": message})

    # -- stopping: everybody may ---------------------------------------------------------------------------

    async def _hold(self, caller: Caller, take: RequestFields) -> Fields:
        robots = self.picture.named(take)
        take.end()
        return await self._halt(caller, "hold", robots, Hold(robots))

    async def _estop(self, caller: Caller, take: RequestFields) -> Fields:
        try:
            robots = self.picture.named(take)
            take.end()
        except RemoteError as error:
            # An estop that is not understood is one for everybody; what was wrong is told afterwards.
            await self._halt(caller, "estop", None, Estop())
            raise RemoteError(error.code, f"{error}; all robots were stopped") from None
        return await self._halt(caller, "estop", robots, Estop(robots))

    async def _stop(self, caller: Caller, take: RequestFields) -> Fields:
        robots, ends = self.picture.named(take), take.flag("end")
        take.end()
        if ends and not self._ended:
            self._ended = True
            self._orders.interrupt()
        return await self._halt(caller, "stop", robots, Stop(robots))

    async def _halt(
        self, caller: Caller, verb: str, robots: tuple[str, ...] | None, order: Message
    ) -> Fields:
        future = self.ledger.order([order])
        message = f"client {caller.name!r} ({verb})"
        holder = self.right.revoke(caller.number, message)
        if holder is not None:
            self._tell(holder.client, {"event": "right", "lost": f"{message} stopped the robots"})
        self.moves.abort_streams(message)
        told = await self._told(future, robots)
        silent = self.picture.silent(robots, self._orders.newest())
        return {**told, "silent": silent} if silent else told

    # -- moving ------------------------------------------------------------------------------------------

    async def _take(self, caller: Caller, take: RequestFields) -> Fields:
        timeout_s = take.number("timeout_s", TIMEOUT_S, LEAST_TIMEOUT_S, GREATEST_TIMEOUT_S)
        takeover = take.flag("takeover")
        take.end()
        now_s = time.monotonic()
        before = self.right.take(caller.number, caller.name, now_s, timeout_s, takeover)
        if before is not None:
            message = f"client {caller.name!r} took over"
            if before.client == 0:
                self._orders.detach_input()
            else:
                self._orders.send(Hold())
                self._tell(before.client, {"event": "right", "lost": message})
            self.moves.abort_streams(message)
            self._orders.say(f"{message} from {before.name!r}; holding")
        return {"timeout_s": timeout_s, "from": None if before is None else before.name}

    async def _release(self, caller: Caller, take: RequestFields) -> Fields:
        take.end()
        if self.moves.streaming(caller.number):
            self._orders.send(Hold())
            self.moves.abort_streams("the motion right was released")
        return {"released": self.right.release(caller.number)}

    async def _resume(self, caller: Caller, take: RequestFields) -> Fields:
        robots = self.picture.named(take)
        take.end()
        self.right.allow(caller.number, time.monotonic())
        self._no_faults(robots)
        return await self._told(self.ledger.order([Resume(robots)]), robots)

    def _no_faults(self, robots: tuple[str, ...] | None) -> None:
        """A robot that is named must not be in FAULT; of all of them, one must not."""
        faults = self.picture.faults(self._orders.newest(), robots)
        if faults and (robots is not None or len(faults) == len(self.picture.configs)):
            told = "; ".join(
                f"{name}: fault {f['number']} {f['name']}, {f['what']}" for name, f in faults.items()
            )
            raise RemoteError(Code.FAULT, f"{told}; clear-fault first", faults)

    async def _clear_fault(self, caller: Caller, take: RequestFields) -> Fields:
        robots = self.picture.named(take)
        take.end()
        self.right.allow(caller.number, time.monotonic())
        wrong = tuple(self.picture.faults(self._orders.newest(), robots))
        for name in wrong:
            self._refusals.pop(name, None)
        if wrong:
            await self.ledger.confirmed(self.ledger.order([ClearFault(wrong)]))
        left = set(wrong)
        deadline_s = time.monotonic() + PATIENCE_S
        while left and time.monotonic() < deadline_s:
            record = self._orders.newest()
            left = {name for name in left if self.picture.mode(name, record) is Mode.FAULT}
            if left and left <= self._refusals.keys():
                break
            await asyncio.sleep(0.02)
        if left:
            message = "; ".join(
                self._refusals.get(name, f"{name}: not cleared, its devices have not answered")
                for name in left
            )
            faults = self.picture.faults(self._orders.newest(), tuple(sorted(left)))
            raise RemoteError(Code.FAULT, message, faults)
        return {"cleared": sorted(wrong), "robots": self._states(robots)}

    async def _move(self, caller: Caller, take: RequestFields) -> Fields:
        target, columns = take.mapping("target"), take.names("columns")
        take.end()
        if (target is None) == (columns is None):
            message = "move takes a target (a point) or columns (a stream of rows), one of them"
            raise RemoteError(Code.BAD_REQUEST, message)
        had = self.right.held_by(caller.number)
        self.right.use(caller.number, caller.name, time.monotonic())
        try:
            if target is not None:
                return await self.moves.point(caller.number, target, caller.tell)
            return await self.moves.begin(caller.number, columns or (), caller.tell)
        except RemoteError:
            if not had:
                self.right.release(caller.number)
            raise

    async def _rows(self, caller: Caller, take: RequestFields) -> Fields:
        number, rows = int(take.number("move", 0, 0, 1e15)), take.rows("rows")
        take.end()
        return self.moves.rows(caller.number, number, rows)

    async def _end(self, caller: Caller, take: RequestFields) -> Fields:
        number = int(take.number("move", 0, 0, 1e15))
        take.end()
        return await self.moves.end(caller.number, number)

    # -- measuring ---------------------------------------------------------------------------------------

    async def _measure(self, caller: Caller, take: RequestFields) -> Fields:
        return self.trackers.measure(caller.number, caller.name, take)

    # -- inside ------------------------------------------------------------------------------------------

    async def _told(self, future: asyncio.Future[Any], robots: tuple[str, ...] | None) -> Fields:
        """The answer to an order: the tick it was obeyed in, and the states after it."""
        outcome = await self.ledger.confirmed(future)
        if outcome.refused:
            faults = self.picture.faults(self._orders.newest(), robots)
            raise RemoteError(Code.REFUSED, "; ".join(outcome.refused.values()), faults)
        return {"tick": outcome.tick, "robots": self._states(robots)}

    def _states(self, robots: tuple[str, ...] | None) -> Fields:
        record = self._orders.newest()
        names = robots if robots is not None else tuple(self.picture.configs)
        return {name: self.picture.mode(name, record).name for name in names}
