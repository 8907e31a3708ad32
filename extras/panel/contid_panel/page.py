"""One open page: its WebSocket, its messages in order of urgency, and its connection to the daemon."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from contid import __version__
from contid.errors import ContidError
from contid.remote.protocol.wire import Code, RemoteError, RequestFields, decode, is_estop
from contid_panel.access import SUBPROTOCOL
from contid_panel.checks import Checks
from contid_panel.expiry import URGENT, clock_ms, valid_until_s, validity
from contid_panel.hub import Hub, encode_message
from contid_panel.limits import MAX_MESSAGE, MessageRate
from contid_panel.mailbox import Mailbox
from contid_panel.page_client import LEASE_TIMEOUT_S, PageClient
from contid_panel.page_orders import READ_ONLY, PageOrders
from contid_panel.poses import PanelPoses

log = logging.getLogger(__name__)

#: Orders of one page that wait for their results; stops are not counted.
MAX_PENDING: Final = 16
#: Unreadable messages after which a page is closed.
MAX_MALFORMED: Final = 10
#: How long a page may take to read one message.
SEND_TIMEOUT_S: Final = 5.0
#: Status of a WebSocket that broke a rule (RFC 6455, 7.4.1), or whose page is too slow.
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013


class Page:
    """The server's side of one page."""

    _numbers = itertools.count(1)

    def __init__(
        self, hub: Hub, checks: Checks, poses: PanelPoses, read_only: bool, demonstrates: bool = False
    ) -> None:
        self._hub = hub
        self._demonstrates = demonstrates
        self._read_only = read_only
        self._mailbox = Mailbox()
        self.number = next(self._numbers)
        self._client = PageClient(hub.path, f"panel page {self.number}")
        self._orders = PageOrders(self._client, hub, checks, poses).orders
        self._rate = MessageRate()
        self._pending: set[asyncio.Task[None]] = set()
        self._stopping: set[asyncio.Task[None]] = set()
        self._malformed = 0
        self._beating = False

    async def serve(self, websocket: WebSocket) -> None:
        """Serve until the page is closed; its lease ends with it."""
        await websocket.accept(subprotocol=SUBPROTOCOL)
        hello = {
            "version": __version__,
            "read_only": self._read_only,
            "page": self.number,
            "demo": self._demonstrates,
        }
        self._send("hello", **hello, lease_timeout_s=LEASE_TIMEOUT_S, clock_ms=clock_ms())
        self._hub.join(self._mailbox)
        self._start(self._connect())
        sender = asyncio.create_task(self._deliver(websocket))
        try:
            code = await self._receive(websocket)
        finally:
            self._hub.leave(self._mailbox)
            sender.cancel()
            for task in self._pending - self._stopping:
                task.cancel()
            # Orders to stop are carried out although their page is gone; its lease lapses meanwhile.
            await asyncio.gather(sender, *self._pending, return_exceptions=True)
            await self._client.abandon()
        with suppress(RuntimeError, WebSocketDisconnect):
            await websocket.close(code)

    def _send(self, kind: str, **fields: Any) -> None:
        self._mailbox.put(encode_message({"kind": kind, **fields}))

    def _start(self, work: Coroutine[Any, Any, None], stops: bool = False) -> None:
        task = asyncio.create_task(work)
        for tasks in (self._pending, self._stopping) if stops else (self._pending,):
            tasks.add(task)
            task.add_done_callback(tasks.discard)

    async def _connect(self) -> None:
        """Connect early: the first press of STOP waits for nothing."""
        with suppress(ContidError, OSError):
            await self._client.client()
        self._send("client", client=self._client.number)

    async def _deliver(self, websocket: WebSocket) -> None:
        """Send what waits; a page that does not read is closed."""
        with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
            while (text := await self._mailbox.take()) is not None:
                async with asyncio.timeout(SEND_TIMEOUT_S):
                    await websocket.send_text(text)
        with suppress(RuntimeError, WebSocketDisconnect):
            await websocket.close(TRY_AGAIN_LATER, "the page does not read")

    async def _receive(self, websocket: WebSocket) -> int:
        """Take in messages; returns the status to close with."""
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return 1000
            given = message.get("text")
            line = given.encode() if given is not None else message.get("bytes") or b""
            stops = is_estop(line)
            if not stops and (not self._rate.spend() or len(line) > MAX_MESSAGE):
                return POLICY_VIOLATION
            self._take(line, stops)
            if self._malformed > MAX_MALFORMED:
                return POLICY_VIOLATION

    def _take(self, line: bytes, stops: bool) -> None:
        """Start one order."""
        number: Any = None
        try:
            fields = decode(line)
            number, verb, pressed_ms = fields.get("id"), fields.get("verb"), fields.pop("pressed_ms", None)
            if not isinstance(verb, str) or verb not in self._orders:
                raise RemoteError(Code.UNKNOWN_VERB, f"unknown verb {str(verb)[:40]!r}")
        except RemoteError as error:
            self._malformed += 1
            self._refuse(number, error)
            if stops:
                self._start(self._carry_out(None, "estop", RequestFields({}), None), stops=True)
            return
        if self._read_only and verb not in READ_ONLY:
            if verb != "beat":
                self._refuse(number, RemoteError(Code.REFUSED, "this panel is read-only; it only stops"))
        elif verb == "beat":
            # One at a time: beats that a slow daemon has not answered yet must not keep the lease longer.
            if not self._beating:
                self._beating = True
                self._start(self._beat(RequestFields(fields), pressed_ms))
        elif verb not in URGENT and len(self._pending) - len(self._stopping) >= MAX_PENDING:
            self._refuse(number, RemoteError(Code.REFUSED, "too many orders wait for their results"))
        else:
            work = self._carry_out(number, verb, RequestFields(fields), pressed_ms)
            self._start(work, stops=verb in URGENT)

    async def _beat(self, request: RequestFields, pressed_ms: object) -> None:
        """Keep the lease; a heartbeat that waited does not."""
        try:
            valid_until_s.set(validity("beat", pressed_ms))
            if self._client.number:
                await self._orders["beat"](request)
        except (ContidError, OSError):
            pass  # it waited, or the daemon has ended, which the hub reports
        finally:
            self._beating = False

    async def _carry_out(self, number: Any, verb: str, request: RequestFields, pressed_ms: object) -> None:
        try:
            valid_until_s.set(validity(verb, pressed_ms))
            result = await self._orders[verb](request)
        except RemoteError as error:
            self._refuse(number, error)
        except (ContidError, OSError) as error:
            self._refuse(number, RemoteError("lost", str(error)))
        except Exception as error:
            # The page waits for a reply, whatever failed.
            log.exception("an order %r of page %d failed", verb, self.number)
            message = f"the panel failed to carry this out ({type(error).__name__}: {error}); see its output"
            self._refuse(number, RemoteError(Code.INTERNAL, message))
        else:
            self._send("reply", id=number, ok=True, result=result)
            if verb in ("acquire", "release") or verb in URGENT:
                self._send("client", client=self._client.number)

    def _refuse(self, number: Any, error: RemoteError) -> None:
        if not isinstance(number, int):
            number = None
        self._send("reply", id=number, ok=False, error=error.as_fields())
