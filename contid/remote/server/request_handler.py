"""Requests of clients: who may ask what, and what happens to a client that disconnects or does not ask.

Every client may read (`contid.remote.server.query_handler`) and stop (`contid.remote.server.stop_orders`).
Moving needs the lease (`contid.remote.server.motion_orders`). Measuring needs no lease; a robot has at most
one tracker (`contid.remote.server.trackers`).
"""

from __future__ import annotations

import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl, RunRecordings
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.events.run import NoteWritten, SourceEnded
from contid.control.engine.messages import Hold
from contid.control.orders import REQUESTS
from contid.errors import ContidError
from contid.remote.protocol.expiry import check_expiry
from contid.remote.protocol.peer_credentials import ClientRole
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.frame_encoder import FrameEncoder
from contid.remote.server.lateness_histogram import LatenessHistogram
from contid.remote.server.lease import INPUT_CLIENT, Lease, LeaseHolder, client_label
from contid.remote.server.motion_orders import MotionOrders
from contid.remote.server.moves import Moves
from contid.remote.server.pending_orders import PendingOrders
from contid.remote.server.query_handler import Caller, QueryHandler, Verb
from contid.remote.server.served_run import ServedRun
from contid.remote.server.stop_orders import StopOrders
from contid.remote.server.telemetry_view import TelemetryView
from contid.remote.server.trackers import Trackers

#: What clients with the role `ClientRole.WATCH` may ask.
WATCH_VERBS: Final = frozenset(verb for verb, request in REQUESTS.items() if request.watches)
#: Orders that are logged when a client speaks for another; one that is repeated, once in this period.
JOURNALLED: Final = frozenset(verb for verb, request in REQUESTS.items() if request.journalled)
JOURNAL_PERIOD_S: Final = 1.0
#: Period in which late ticks are counted; the ring holds more.
COUNT_PERIOD_S: Final = 0.5

log = logging.getLogger(__name__)


class RequestHandler:
    """The verbs of the socket, and what they share.

    Attributes:
        view: the robots in telemetry.
        frames: telemetry, encoded.
        pending: orders that are not confirmed.
        moves: in progress.
        trackers: clients that measure.
        lease: of the motion of the robots.
        stops: orders to stop.
        queries: requests that only read.
    """

    def __init__(
        self,
        control: RunControl,
        notify: Callable[[int, Mapping[str, Any]], None],
        clients: Callable[[], int],
        recordings: RunRecordings | None = None,
    ) -> None:
        """Serve a run.

        Args:
            control: of the run.
            notify: sends a notice to a client by number.
            clients: number of clients that are connected.
            recordings: of the run; None for a run that keeps none.
        """
        self._recordings = recordings
        self._control = control
        self._notify = notify
        self._busy: Counter[int] = Counter()
        self._logged_s: dict[tuple[int, str], float] = {}
        self._counted_s = -math.inf
        self.view = TelemetryView(control.loaded, control.rate_hz, control.refresh)
        self.frames = FrameEncoder(self.view.field)
        self.pending = PendingOrders(control)
        self.moves = Moves(control, self.view, self.pending)
        self.trackers = Trackers(control, self.view)
        self.lease = Lease(time.monotonic(), control.input_active)
        run = ServedRun(control, self.view, self.pending, self.moves, self.lease, notify)
        self.stops = StopOrders(run)
        self._motions = MotionOrders(run)
        self._lateness = LatenessHistogram(control)
        self.queries = QueryHandler(
            control, self.view, self.lease, self.trackers, clients, self._lateness, recordings
        )
        self._verbs: dict[str, Verb] = {
            **self.queries.verbs,
            **self.stops.verbs,
            **self._motions.verbs,
            "measure": self._measure,
            "note": self._note,
            "record": self._record,
        }

    async def serve(self, caller: Caller, fields: Mapping[str, Any]) -> Fields:
        """Carry out one request.

        Raises:
            RemoteError: it was refused.
        """
        verb = fields.get("verb")
        if not isinstance(verb, str) or verb not in self._verbs:
            message = f"unknown verb {str(verb)[:60]!r}; there are {', '.join(self._verbs)}"
            raise RemoteError(Code.UNKNOWN_VERB, message)
        # A stop with ``end`` also ends the run.
        if caller.role is ClientRole.WATCH and (verb not in WATCH_VERBS or fields.get("end")):
            message = "a member of the group of --watch-group may only read, and hold, stop and estop"
            raise RemoteError(Code.FORBIDDEN, message)
        given = check_expiry(verb, dict(fields))  # before the lease: a request that is late keeps no lease
        if caller.by and verb in JOURNALLED:
            self._journal(caller, verb)
        self._busy[caller.number] += 1
        try:
            self.lease.refresh(caller.number, time.monotonic())
            return await self._verbs[verb](caller, RequestFields(given))
        finally:
            # A client that waits for a response keeps the lease, however long the request takes.
            self.lease.refresh(caller.number, time.monotonic())
            self._busy[caller.number] -= 1
            if not self._busy[caller.number]:
                del self._busy[caller.number]

    def _journal(self, caller: Caller, verb: str) -> None:
        """Log an order of a client that speaks for another."""
        now_s = time.monotonic()
        if now_s > self._logged_s.get((caller.number, verb), -math.inf) + JOURNAL_PERIOD_S:
            self._logged_s[caller.number, verb] = now_s
            log.info("%s: %s", client_label(caller.name, caller.by), verb)

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        if isinstance(event, OrderRefused):
            self._motions.notice(event)
        elif isinstance(event, SourceEnded) and self.lease.held_by(INPUT_CLIENT):
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
        self.moves.watch()
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
        """Let the robots hold, because their holder has lost the lease; ``message`` states why."""
        self._control.send(Hold())
        self.moves.stop(message)
        log.warning("%s lost the lease (%s); holding", holder.label, message)
        self._notify(holder.client, {"event": "lease-lost", "message": message})

    async def _note(self, caller: Caller, request: RequestFields) -> Fields:
        """Write a note of the holder of the lease into the recording."""
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
        """Take a measured tip of a tracker."""
        return await self.trackers.measure(caller.number, caller.name, request)
