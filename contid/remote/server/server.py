"""The socket server of the daemon: connections, telemetry, and the periodic checks of leases and credits."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl, RunRecordings
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusChanged, ControlStalled, StalenessChanged, TicksSkipped
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.robots import FaultLatched, ModeChanged, OrderRefused
from contid.control.engine.events.run import SourceEnded, StopBegan
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.faults import Fault
from contid.remote.protocol.peer_credentials import ClientRole, peer_of, role_of
from contid.remote.protocol.socket_path import Endpoint
from contid.remote.protocol.wire import MAX_CLIENTS, Fields, encode
from contid.remote.server.acceptor import Acceptor
from contid.remote.server.connection import Connection
from contid.remote.server.query_handler import Subscription
from contid.remote.server.request_handler import RequestHandler
from contid.remote.server.telemetry_view import fault_fields
from contid.remote.server.turns import Turns

#: Period of the checks of leases, credits and due frames, while a client needs them and otherwise.
WATCH_S: Final = 0.005
IDLE_S: Final = 0.02
#: Period of the look for a record that is expected now.
LOOK_S: Final = 5e-4
#: Longest time for telemetry before requests get a turn.
FRAMES_S: Final = 1e-3
#: Time for connections to close when the daemon ends.
CLOSE_TIMEOUT_S: Final = 1.0
#: Kinds of events that subscribers receive.
EVENTS: Final = (
    BusChanged, FaultLatched, ModeChanged, OrderRefused, SourceEnded, StalenessChanged, StopBegan,
    TicksSkipped, ControlStalled,
)  # fmt: skip
log = logging.getLogger(__name__)


class SocketServer:
    """Commands from a Unix socket (`contid.control.daemon.interfaces.CommandSource`)."""

    def __init__(self, endpoint: Endpoint, recordings: RunRecordings | None = None) -> None:
        self._endpoint = endpoint
        self._recordings = recordings
        self._connections: dict[int, Connection] = {}
        self._runs: set[asyncio.Task[None]] = set()
        self._numbers = 0
        self._expected_s = 0.0
        self._turns = Turns()
        self._asking: asyncio.Task[None] | None = None
        self._handler: RequestHandler

    async def serve(self, control: RunControl) -> None:
        """Serve until cancelled."""
        handler = self._handler = RequestHandler(
            control, self._notify, lambda: len(self._connections), self._recordings
        )
        control.listen(self._event)
        acceptor = Acceptor(self._endpoint.socket, self._accept, self._displace)
        try:
            while True:
                busy = handler.streaming or any(c.subscription for c in self._connections.values())
                await asyncio.sleep(self._pause_s(1.0 / control.rate_hz) if busy else IDLE_S)
                handler.watch()
                if (again := self._endpoint.again()) is not None:  # a stop must always find its way in
                    log.warning("%s was removed; listening there again", again.path)
                    acceptor.close()
                    self._endpoint.close()
                    self._endpoint = again
                    acceptor = Acceptor(again.socket, self._accept, self._displace)
                await self._send_frames(control)
        finally:
            if self._asking is not None:
                self._asking.cancel()
            acceptor.close()
            for connection in tuple(self._connections.values()):
                connection.disconnect("the daemon ends")
            # They close by themselves.
            if self._runs:
                await asyncio.wait(self._runs, timeout=CLOSE_TIMEOUT_S)
            handler.pending.close()
            self._endpoint.close()

    # -- clients -----------------------------------------------------------------------------------------

    def _accept(self, connected: socket.socket) -> None:
        """Serve a client that connected, in a task of its own."""
        try:
            role = role_of(peer_of(connected), self._endpoint.group, self._endpoint.watch_group)
        except OSError:  # disconnected already
            role = None
        connected.setblocking(False)
        if role is None:
            with suppress(OSError), connected:
                connected.send(encode({"event": "bye", "message": "this daemon belongs to another user"}))
            return
        task = asyncio.create_task(self._serve_client(connected, role))
        self._runs.add(task)
        task.add_done_callback(self._runs.discard)

    async def _serve_client(self, connected: socket.socket, role: ClientRole) -> None:
        self._numbers += 1
        connection = Connection(self._numbers, self._handler, self._turns, role)
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, connected)
        if len(self._connections) >= MAX_CLIENTS:
            self._displace()
        self._connections[connection.number] = connection
        try:
            await connection.run()
        finally:
            self._connections.pop(connection.number, None)
            self._handler.disconnected(connection.number)

    def _displace(self) -> None:
        """Disconnect a client that does not hold the lease: a stop always gets in.

        First of those that have sent nothing, the one that was idle longest.
        """
        others = [c for c in self._connections.values() if not self._handler.lease.held_by(c.number)]
        if others:
            idle = min(others, key=lambda other: (other.receiver.active, other.receiver.active_s))
            del self._connections[idle.number]
            idle.disconnect("another client needed the place; this one was idle longest")

    def _notify(self, client: int, fields: Mapping[str, Any]) -> None:
        if client in self._connections:
            self._connections[client].notify(fields)

    # -- telemetry and events ----------------------------------------------------------------------------

    def _event(self, event: RunEvent) -> None:
        """Pass an event of the ring to the handler and to subscribers of events."""
        self._handler.notice(event)
        if not isinstance(event, EVENTS):
            return
        notice: Fields = {"event": "event", "kind": event.KIND}
        notice |= {key: value for key, value in to_json(event).items() if key != "event"}
        if isinstance(event, FaultLatched):
            notice["fault"] = fault_fields(Fault(event.fault), event.detail)
        line = encode(notice)
        for connection in tuple(self._connections.values()):
            if connection.subscription is not None and connection.subscription.events:
                connection.outbox.put_frame(line)

    def _pause_s(self, tick_s: float) -> float:
        """Until the next look: a frame that is due with the next record goes out as soon as that is there."""
        left_s = self._expected_s - time.monotonic()
        subscribed = [c.subscription for c in self._connections.values() if c.subscription is not None]
        if self._asking is not None and not self._asking.done():
            subscribed = [each for each in subscribed if not self._needs_answers(each)]
        due = any(each.due(self._expected_s, tick_s) for each in subscribed)
        # A control process that stands still is not looked at more often for it.
        return min(max(left_s, LOOK_S), WATCH_S) if due and left_s > -tick_s else WATCH_S

    async def _send_frames(self, control: RunControl) -> None:
        """Send the telemetry that is due; requests get a turn in between."""
        tick_s = 1.0 / control.rate_hz
        now_s = turn_s = time.monotonic()
        due = [
            (connection, subscription)
            for connection in self._connections.values()
            if (subscription := connection.subscription) is not None and subscription.due(now_s, tick_s)
        ]
        record = control.newest() if due else None
        if record is None:
            return
        self._expected_s = record.deadline_s + tick_s + record.work_s
        asking: list[tuple[Connection, Subscription]] = []
        for connection, subscription in due:
            if subscription.tick == record.tick:
                continue
            if self._needs_answers(subscription):
                if self._asking is None or self._asking.done():
                    subscription.sent(now_s, record.tick, self._handler.queries.telemetry_hz)
                    asking.append((connection, subscription))
                continue
            subscription.sent(now_s, record.tick, self._handler.queries.telemetry_hz)
            self._send_frame(connection, subscription, record)
            if time.monotonic() - turn_s > FRAMES_S:
                await asyncio.sleep(0)
                turn_s = time.monotonic()
        if asking:
            if self._asking is not None:
                self._asking.result()  # an error of the frames before
            self._asking = asyncio.create_task(self._send_answered(asking, record))

    def _needs_answers(self, subscription: Subscription) -> bool:
        return self._handler.view.answers.needed(subscription.robots, subscription.fields)

    async def _send_answered(self, due: list[tuple[Connection, Subscription]], record: TickRecord) -> None:
        """Send frames once isolated models have answered; other frames and requests do not wait for them."""
        robots = {robot for _, subscription in due for robot in subscription.robots}
        fields = {field for _, subscription in due for field in subscription.fields}
        await self._handler.view.answers.ask(record, robots, fields)
        for connection, subscription in due:
            if connection.subscription is subscription:  # it may have another one meanwhile, or none
                self._send_frame(connection, subscription, record)

    def _send_frame(self, connection: Connection, subscription: Subscription, record: TickRecord) -> None:
        line = self._handler.frames.line(record, subscription.robots, subscription.fields)
        if dropped := connection.outbox.dropped:
            line = line[:-2] + b',"dropped":%d}\n' % dropped
        connection.outbox.put_frame(line)
