"""Requests of clients, one method per verb; those that only read are in `contid.remote.server.query_handler`.

Every client may read, and every client may hold, stop and estop: these orders are sent before anything else
is checked. Moving needs the lease (`contid.remote.server.lease`), which a stop by another client revokes.
Measuring needs no lease; a robot has at most one tracker (`contid.remote.server.trackers`).
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events import NoteWritten, OrderRefused, RunEvent, SourceEnded
from contid.control.engine.messages import ClearFault, Estop, Grip, Hold, Message, Recover, Resume, Stop
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.remote.protocol.estop_line import ESTOP
from contid.remote.protocol.peer_credentials import ClientRole
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields, decode
from contid.remote.server.frame_encoder import FrameEncoder
from contid.remote.server.lateness_histogram import LatenessHistogram
from contid.remote.server.lease import (
    MAX_TIMEOUT_S,
    MIN_TIMEOUT_S,
    TIMEOUT_S,
    Lease,
    LeaseHolder,
    client_label,
)
from contid.remote.server.moves import Moves
from contid.remote.server.pending_orders import CONFIRM_TIMEOUT_S, OrderResult, PendingOrders
from contid.remote.server.query_handler import Caller, QueryHandler, Verb
from contid.remote.server.recordings import RunRecordings
from contid.remote.server.telemetry_view import TelemetryView
from contid.remote.server.trackers import Trackers

#: What clients with the role `ClientRole.WATCH` may ask.
WATCH_VERBS: Final = frozenset(
    {"hello", "ping", "status", "describe", "subscribe", "unsubscribe", "hold", "stop", "estop"}
)
#: Orders that are logged when a client speaks for another.
JOURNALLED: Final = frozenset(
    {"hold", "stop", "estop", "acquire", "release", "resume", "recover", "clear_fault", "grip"}
)
JOURNAL_PERIOD_S: Final = 1.0
#: Period in which late ticks are counted; the ring holds more.
COUNT_PERIOD_S: Final = 0.5

log = logging.getLogger(__name__)


class RequestHandler:
    """The verbs of the socket, and what they share."""

    def __init__(
        self,
        control: RunControl,
        notify: Callable[[int, Mapping[str, Any]], None],
        clients: Callable[[], int],
        recordings: RunRecordings | None = None,
    ) -> None:
        """Serve a run; ``notify`` sends a notice to a client by number, ``clients`` counts the clients."""
        self._recordings = recordings
        self._control = control
        self._notify = notify
        self._ended = False
        self._refusals: dict[str, str] = {}
        self._busy: Counter[int] = Counter()
        self._logged_s: dict[tuple[int, str], float] = {}
        self._counted_s = 0.0
        self.view = TelemetryView(control.loaded, control.rate_hz, control.refresh)
        self.frames = FrameEncoder(self.view.field)
        self.pending = PendingOrders(control.send, control.refresh, self._newest_tick)
        self.moves = Moves(control, self.view, self.pending)
        self.trackers = Trackers(control, self.view)
        self.lease = Lease(time.monotonic(), control.input_active)
        self._lateness = LatenessHistogram(control)
        self.queries = QueryHandler(control, self.view, self.lease, self.trackers, clients, self._lateness)
        self.queries.recordings = recordings
        self._verbs: dict[str, Verb] = {
            **self.queries.verbs,
            "hold": self._hold, "stop": self._stop, "estop": self._estop,
            "acquire": self._acquire, "release": self._release, "resume": self._resume,
            "clear_fault": self._clear_fault, "recover": self._recover, "measure": self._measure,
            "move": self._move, "rows": self._rows, "end": self._end, "grip": self._grip,
            "start": self._start, "note": self._note, "record": self._record,
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
        if caller.role is ClientRole.WATCH and (verb not in WATCH_VERBS or fields.get("end")):
            message = "a member of the group of --watch-group may only read, and hold, stop and estop"
            raise RemoteError(Code.FORBIDDEN, message)
        if caller.by and verb in JOURNALLED:
            self._journal(caller, verb)
        self._busy[caller.number] += 1
        try:
            self.lease.refresh(caller.number, time.monotonic())
            return await self._verbs[verb](caller, RequestFields(fields))
        finally:
            # A client that waits for a response keeps the lease, however long the request takes.
            self.lease.refresh(caller.number, time.monotonic())
            self._busy[caller.number] -= 1
            if not self._busy[caller.number]:
                del self._busy[caller.number]

    def _journal(self, caller: Caller, verb: str) -> None:
        """Log an order of a client that speaks for another; one that is repeated, once a second."""
        now_s = time.monotonic()
        if now_s > self._logged_s.get((caller.number, verb), 0.0) + JOURNAL_PERIOD_S:
            self._logged_s[caller.number, verb] = now_s
            log.info("%s: %s", client_label(caller.name, caller.by), verb)

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        if isinstance(event, OrderRefused):
            self._refusals[event.robot] = event.message
        elif isinstance(event, SourceEnded) and self.lease.held_by(0):
            self.lease.holder = None
        self.queries.notice(event)
        self.view.notice(event)
        self.pending.notice(event)
        self.moves.notice(event)

    @property
    def streaming(self) -> bool:
        """True while rows or measurements may come."""
        return self.moves.open or self.trackers.active

    def watch(self) -> None:
        """Grant credit, send measurements, expire the lease; called periodically."""
        now_s = time.monotonic()
        if now_s > self._counted_s + COUNT_PERIOD_S:
            self._counted_s = now_s
            self._lateness.update()
            if self._recordings is not None:
                self._recordings.watch()
        self.moves.refill()
        self.trackers.watch(now_s)
        holder = self.lease.holder
        if holder is not None and holder.client in self._busy:
            return
        holder = self.lease.expire(now_s)
        if holder is not None:
            self._lapsed(holder, f"no request for {holder.timeout_s:g} s")

    def disconnected(self, client: int) -> None:
        """A client disconnected; if it held the lease, the robots hold."""
        self.trackers.disconnected(client)
        self._logged_s = {key: value for key, value in self._logged_s.items() if key[0] != client}
        holder = self.lease.holder
        if holder is not None and holder.client == client:
            self.lease.holder = None
            self._lapsed(holder, "its connection ended")

    def _lapsed(self, holder: LeaseHolder, message: str) -> None:
        self._control.send(Hold())
        self.moves.abort_streams(message)
        log.warning("%s lost the lease (%s); holding", holder.label, message)
        self._notify(holder.client, {"event": "lease-lost", "message": message})

    # -- stopping: every client may ------------------------------------------------------------------------

    async def _hold(self, caller: Caller, request: RequestFields) -> Fields:
        robots = self.view.named(request)
        request.end()
        return await self._halt(caller, "hold", robots, Hold(robots))

    async def _estop(self, caller: Caller, request: RequestFields) -> Fields:
        try:
            robots = self.view.named(request)
            request.end()
        except RemoteError as error:
            raise await self.obey_malformed_estop(caller, error) from None
        return await self._halt(caller, "estop", robots, Estop(robots))

    def estop_all(self, caller: Caller) -> None:
        """Stop all robots for a client that gets no response any more."""
        self._send_stop(caller, "estop", Estop())

    def estop_before_turn(self, caller: Caller, line: bytes) -> None:
        """Send the emergency stop of a line that has just arrived: of the robots it names, else of all."""
        try:
            fields = decode(line)
            request = RequestFields(fields)
            robots = self.view.named(request) if fields.get("verb") == ESTOP else None
            request.end()
        except RemoteError:
            robots = None
        self._send_stop(caller, "estop", Estop(robots))

    async def obey_malformed_estop(self, caller: Caller, error: RemoteError) -> RemoteError:
        """Stop all robots for an estop with a mistake; returns the refusal to send."""
        await self._halt(caller, "estop", None, Estop())
        return RemoteError(error.code, f"{error}; all robots were stopped")

    async def _stop(self, caller: Caller, request: RequestFields) -> Fields:
        robots, ends = self.view.named(request), request.flag("end")
        request.end()
        if ends and not self._ended:
            self._ended = True
            self._control.interrupt()
        return await self._halt(caller, "stop", robots, Stop(robots))

    async def _halt(
        self, caller: Caller, verb: str, robots: tuple[str, ...] | None, order: Message
    ) -> Fields:
        result = await self._confirmed(self._send_stop(caller, verb, order), robots)
        silent = self.view.silent(robots, self._control.newest())
        return {**result, "silent": silent} if silent else result

    def _send_stop(self, caller: Caller, verb: str, order: Message) -> asyncio.Future[OrderResult]:
        """Send an order to stop at once; then the lease and the streams."""
        future = self.pending.send([order])
        message = f"{client_label(caller.name, caller.by)} ({verb})"
        holder = self.lease.stop(caller.number, message)
        if holder is not None:
            self._notify(holder.client, {"event": "lease-lost", "message": f"{message} stopped the robots"})
        self.moves.abort_streams(message)
        return future

    # -- moving ------------------------------------------------------------------------------------------

    async def _acquire(self, caller: Caller, request: RequestFields) -> Fields:
        timeout_s = request.number("timeout_s", TIMEOUT_S, MIN_TIMEOUT_S, MAX_TIMEOUT_S)
        takeover, unless_stopped = request.flag("takeover"), request.flag("unless_stopped")
        request.end()
        before = self.lease.acquire(
            caller.number, caller.name, time.monotonic(), timeout_s, takeover, caller.by, unless_stopped
        )
        if before is not None:
            message = f"{client_label(caller.name, caller.by)} took over"
            if before.client == 0:
                self._control.detach_input()
            else:
                self._control.send(Hold())
                self._notify(before.client, {"event": "lease-lost", "message": message})
            self.moves.abort_streams(message)
            log.warning("%s from %r; holding", message, before.name)
        return {"timeout_s": timeout_s, "from": None if before is None else before.name}

    async def _release(self, caller: Caller, request: RequestFields) -> Fields:
        request.end()
        if self.moves.streaming(caller.number):
            self._control.send(Hold())
            self.moves.abort_streams("the lease was released")
        return {"released": self.lease.release(caller.number)}

    async def _resume(self, caller: Caller, request: RequestFields) -> Fields:
        robots, after_stop = self.view.named(request), request.flag("after_stop")
        request.end()
        self.lease.allow(caller.number, time.monotonic(), after_stop)
        faults = self.view.faults(self._control.newest(), robots)
        # A robot that is named must not be in FAULT; without names, one robot that can resume is enough.
        if faults and (robots is not None or len(faults) == len(self.view.configs)):
            found = "; ".join(
                f"{name}: fault {f['number']} {f['name']}, {f['what']}" for name, f in faults.items()
            )
            raise RemoteError(Code.FAULT, f"{found}; clear-fault first", faults)
        return await self._confirmed(self.pending.send([Resume(robots)]), robots)

    async def _recover(self, caller: Caller, request: RequestFields) -> Fields:
        robots, after_stop = self.view.named(request), request.flag("after_stop")
        request.end()
        self.lease.allow(caller.number, time.monotonic(), after_stop)
        return await self._confirmed(self.pending.send([Recover(robots)]), robots)

    async def _clear_fault(self, caller: Caller, request: RequestFields) -> Fields:
        robots = self.view.named(request)
        request.end()
        self.lease.check_free(caller.number, time.monotonic())
        faulty = tuple(self.view.faults(self._control.newest(), robots))
        for name in faulty:
            self._refusals.pop(name, None)
        if faulty:
            await self.pending.confirmed(self.pending.send([ClearFault(faulty)]))
        left = set(faulty)
        deadline_s = time.monotonic() + CONFIRM_TIMEOUT_S
        while left and time.monotonic() < deadline_s:
            record = self._control.newest()
            left = {name for name in left if self.view.mode(name, record) is Mode.FAULT}
            if left and left <= self._refusals.keys():
                break
            await asyncio.sleep(0.02)
        if left:
            message = "; ".join(
                self._refusals.get(name, f"{name}: not cleared, its devices have not answered")
                for name in left
            )
            faults = self.view.faults(self._control.newest(), tuple(sorted(left)))
            raise RemoteError(Code.FAULT, message, faults)
        return {"cleared": sorted(faulty), "robots": self._states(robots)}

    async def _move(self, caller: Caller, request: RequestFields) -> Fields:
        target, columns = request.mapping("target"), request.names("columns")
        request.end()
        if (target is None) == (columns is None):
            message = "move takes a target (a point) or columns (a stream of rows), one of them"
            raise RemoteError(Code.BAD_REQUEST, message)
        held = self.lease.held_by(caller.number)
        self.lease.require(caller.number, caller.name, time.monotonic(), caller.by)
        try:
            if target is not None:
                return await self.moves.point(caller.number, target, caller.notify)
            return await self.moves.begin(caller.number, columns or (), caller.notify)
        except RemoteError:
            if not held:
                self.lease.release(caller.number)
            raise

    async def _grip(self, caller: Caller, request: RequestFields) -> Fields:
        robots, share = self.view.named(request), request.number("share", -1.0, 0.0, 1.0)
        request.end()
        self.lease.check_free(caller.number, time.monotonic())
        return {**await self._confirmed(self.pending.send([Grip(share, robots)]), robots), "share": share}

    async def _rows(self, caller: Caller, request: RequestFields) -> Fields:
        number, rows = int(request.number("move", 0, 0, 1e15)), request.rows("rows")
        request.end()
        return self.moves.rows(caller.number, number, rows)

    async def _end(self, caller: Caller, request: RequestFields) -> Fields:
        number, hold = int(request.number("move", 0, 0, 1e15)), request.flag("hold_at_start")
        request.end()
        return await self.moves.end(caller.number, number, hold)

    async def _start(self, caller: Caller, request: RequestFields) -> Fields:
        number, at_s = int(request.number("move", 0, 0, 1e15)), request.number("at_s", -1.0, -1.0, 1e12)
        request.end()
        return await self.moves.start(caller.number, number, None if at_s < 0.0 else at_s)

    async def _note(self, caller: Caller, request: RequestFields) -> Fields:
        note = NoteWritten(
            experiment=request.text("experiment", ""),
            node=request.text("node", ""),
            conductor=request.text("conductor", ""),
            at_s=request.number("at_s", 0.0, -1e12, 1e12),
            offset_s=request.number("offset_s", 0.0, -1e12, 1e12),
            bound_s=request.number("bound_s", 0.0, 0.0, 1e12),
            wall_s=request.number("wall_s", 0.0, -1e12, 1e12),
            message=request.text("message", ""),
        )
        request.end()
        if not self.lease.held_by(caller.number):
            raise RemoteError(Code.REFUSED, "note: only the holder of the lease writes into the recording")
        self._control.note(note)
        return {}

    async def _record(self, caller: Caller, request: RequestFields) -> Fields:
        """Begin or end a recording; like a measurement it moves nothing and needs no lease."""
        ends = request.flag("end")
        request.end()
        if self._recordings is None:
            raise RemoteError(Code.REFUSED, "record: this run keeps no recordings")
        by = caller.by or caller.name
        try:
            path, done = await (self._recordings.end(by) if ends else self._recordings.begin(by))
        except ContidError as error:
            raise RemoteError(Code.REFUSED, f"record: {error}") from None
        return {"file": str(path.absolute()), "done": done}

    async def _measure(self, caller: Caller, request: RequestFields) -> Fields:
        return self.trackers.measure(caller.number, caller.name, request)

    # -- inside ------------------------------------------------------------------------------------------

    async def _confirmed(self, future: asyncio.Future[OrderResult], robots: tuple[str, ...] | None) -> Fields:
        """The result of an order: the tick that obeyed it, the states after it, and who refused it.

        Raises:
            RemoteError: every robot refused.
        """
        outcome = await self.pending.confirmed(future)
        result: Fields = {"tick": outcome.tick, "robots": self._states(robots)}
        if not outcome.refused:
            return result
        if outcome.refused.keys() >= result["robots"].keys() or "" in outcome.refused:
            faults = self.view.faults(self._control.newest(), robots)
            raise RemoteError(Code.REFUSED, "; ".join(outcome.refused.values()), faults)
        return {**result, "refused": dict(outcome.refused)}

    def _newest_tick(self) -> int | None:
        record = self._control.newest()
        return None if record is None else record.tick

    def _states(self, robots: tuple[str, ...] | None) -> Fields:
        record = self._control.newest()
        names = robots if robots is not None else tuple(self.view.configs)
        return {name: self.view.mode(name, record).name for name in names}
