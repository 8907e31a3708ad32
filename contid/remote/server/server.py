"""The server behind the socket: who may connect, what everybody is told, what time brings about."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.tick.faults import Fault
from contid.remote.protocol.peer_credentials import is_authorized, peer_of
from contid.remote.protocol.socket_path import Endpoint
from contid.remote.protocol.wire import MAX_CLIENTS, MAX_LINE, encode
from contid.remote.server.connection import Connection
from contid.remote.server.request_handler import RequestHandler
from contid.remote.server.telemetry_view import fault_fields

#: How often leases, credits and due frames are looked at, while somebody waits for such and otherwise.
WATCH_S: Final = 0.005
IDLE_S: Final = 0.02
#: How long connections get to end with the daemon.
LEAVE_S: Final = 1.0
#: What subscribers of events hear of.
EVENTS: Final = frozenset({"state", "fault", "refused", "bus", "tier", "skipped", "end", "stopping"})


class SocketServer:
    """Takes commands over a socket (`contid.control.daemon.interfaces.Commands`)."""

    def __init__(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._connections: dict[int, Connection] = {}
        self._runs: set[asyncio.Task[None]] = set()
        self._numbers = 0
        self._frames: dict[tuple[Any, ...], bytes] = {}
        self._frames_of = -1
        self._verbs: RequestHandler | None = None

    async def serve(self, orders: RunControl) -> None:
        """Serve until cancelled."""
        verbs = self._verbs = RequestHandler(orders, self._tell, lambda: len(self._connections))
        orders.listen(self._notice)
        server = await asyncio.start_unix_server(self._enter, sock=self._endpoint.socket, limit=MAX_LINE)
        try:
            while True:
                busy = verbs.streaming or any(c.subscription for c in self._connections.values())
                await asyncio.sleep(WATCH_S if busy else IDLE_S)
                verbs.watch()
                self._send_frames(orders)
        finally:
            server.close()
            for connection in tuple(self._connections.values()):
                connection.send_away("the daemon ends")
            # They leave by themselves; cancelling them would be told as an error by asyncio's streams.
            if self._runs:
                await asyncio.wait(self._runs, timeout=LEAVE_S)
            verbs.ledger.close()
            self._endpoint.close()

    # -- clients -----------------------------------------------------------------------------------------

    async def _enter(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """A client connected; its own task serves it."""
        task = asyncio.current_task()
        assert task is not None
        assert self._verbs is not None
        try:
            allowed = is_authorized(peer_of(writer.get_extra_info("socket")), self._endpoint.group)
        except OSError:  # gone already
            allowed = False
        if not allowed:
            writer.write(encode({"event": "bye", "message": "this daemon belongs to another user"}))
            with suppress(OSError, ConnectionError):
                writer.close()
            return
        self._numbers += 1
        connection = Connection(self._numbers, reader, writer, self._verbs)
        self._make_room()
        self._connections[connection.number] = connection
        self._runs.add(task)
        try:
            await connection.run()
        finally:
            self._runs.discard(task)
            self._connections.pop(connection.number, None)
            self._verbs.gone(connection.number)

    def _make_room(self) -> None:
        """One client too many displaces the one that was idle longest, so that a stop always gets in."""
        assert self._verbs is not None
        if len(self._connections) < MAX_CLIENTS:
            return
        others = [c for c in self._connections.values() if not self._verbs.right.held_by(c.number)]
        idle = min(others, key=lambda connection: connection.active_s)
        del self._connections[idle.number]
        idle.send_away(f"more than {MAX_CLIENTS} clients; this one was idle longest")

    def _tell(self, client: int, fields: Mapping[str, Any]) -> None:
        if client in self._connections:
            self._connections[client].tell(fields)

    # -- what is sent unasked ----------------------------------------------------------------------------

    def _notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring, for the verbs and for whoever subscribed to events."""
        assert self._verbs is not None
        self._verbs.notice(event)
        if event["event"] not in EVENTS:
            return
        told: dict[str, Any] = {"event": "event", "kind": event["event"]}
        told |= {key: value for key, value in event.items() if key != "event"}
        if event["event"] == "fault":
            told["fault"] = fault_fields(Fault(event["fault"]), str(event.get("detail", "")))
        line = encode(told)
        for connection in tuple(self._connections.values()):
            if connection.subscription is not None and connection.subscription.events:
                connection.outbox.frame(line)

    def _send_frames(self, orders: RunControl) -> None:
        """Telemetry that is due; frames alike are made once."""
        now_s = time.monotonic()
        due = [
            connection
            for connection in self._connections.values()
            if (wanted := connection.subscription) is not None and wanted.rate_hz and now_s >= wanted.next_s
        ]
        if not due:
            return
        record = orders.newest()
        if record is None:
            return
        assert self._verbs is not None
        if record.tick != self._frames_of:
            self._frames, self._frames_of = {}, record.tick
        for connection in due:
            wanted = connection.subscription
            assert wanted is not None
            if wanted.tick == record.tick:
                continue
            late_s = now_s - wanted.next_s
            period_s = 1.0 / wanted.rate_hz
            wanted.next_s = wanted.next_s + period_s if late_s < period_s else now_s + period_s
            wanted.tick = record.tick
            key = (wanted.robots, wanted.fields)
            if key not in self._frames:
                fields = self._verbs.picture.telemetry(record, *key)
                self._frames[key] = encode({"event": "telemetry", **fields})
            connection.outbox.frame(self._with_drops(connection, self._frames[key]))

    @staticmethod
    def _with_drops(connection: Connection, line: bytes) -> bytes:
        dropped = connection.outbox.dropped
        return line[:-2] + b',"dropped":%d}\n' % dropped if dropped else line
