"""The local connection of one session of an operator to one node: its requests, its lease, its rows.

The lease is refreshed by the requests of the operator and by nothing else. Of live rows the newest wins:
while one waits for credit, a further one takes its place.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.remote.client.client_protocol import RESPONSE_TIMEOUT_S, VERB_TIMEOUT_S
from contid.remote.protocol.wire import PROTOCOL, Code, ConnectionLostError, Fields, RemoteError
from contid_fleet.keys import Origin
from contid_fleet.links.daemon_link import DaemonLink, refusal
from contid_fleet.rights import GREETING, LEASED, STOPS

#: Code of this bridge, beside those of the socket.
NO_LEASE: Final = "no-lease"
#: Requests of a session under way. Of rows at most two are: one that is sent, and one that waits.
MAX_UNDER_WAY: Final = 32
UNCOUNTED: Final = STOPS | {"rows", "end"}
#: Longest lease by network: an order that waited in a bridge that stood still must find it lapsed.
MAX_LEASE_S: Final = 5.0
LEASE_S: Final = 1.0


class OperatorLink:
    """A connection to the daemon of a node for one session; it connects at its first request.

    Args:
        path: path of the socket.
        origin: whose it is.
        noticed: called with each line of the daemon that is no response; False for telemetry.

    Attributes:
        used_s: time of the last request.
    """

    def __init__(self, path: Path, origin: Origin, noticed: Callable[[bytes, bool], None]) -> None:
        self.used_s = time.monotonic()
        self._path = path
        self._origin = origin
        self._noticed = noticed
        self._link: DaemonLink | None = None
        self._number = 0
        self._connecting = asyncio.Lock()
        self._closed = False
        self._under_way = 0
        self._stops = 0
        self._rows = _LiveRows()

    async def request(self, verb: str, fields: Fields) -> Fields:
        """The response to a request that the operator may make; never raises for a refusal."""
        self.used_s = time.monotonic()
        if verb not in UNCOUNTED and self._under_way >= MAX_UNDER_WAY:
            return refusal(Code.REFUSED, f"{MAX_UNDER_WAY} requests of this session are under way")
        self._under_way += verb not in UNCOUNTED
        self._stops += verb in STOPS
        try:
            async with asyncio.timeout(VERB_TIMEOUT_S.get(verb, RESPONSE_TIMEOUT_S)):
                response = await self._request(verb, fields)
                # Another number reveals a new connection, without lease and moves, to the operator.
                return {**response, "client": self._number}
        except RemoteError as error:
            return {"ok": False, "error": error.as_fields()}
        except (ContidError, OSError, TimeoutError) as error:
            return refusal(Code.NO_ANSWER, str(error) or "the daemon did not answer in time")
        finally:
            self._under_way -= verb not in UNCOUNTED

    def close(self) -> None:
        """End the connection for good, without a release: if it held the lease, the robots hold."""
        self._closed = True
        if self._link is not None:
            self._link.close()
            self._link = None
        self._rows.clear("the session of this operator ended")

    async def _request(self, verb: str, fields: Fields) -> Fields:
        stops = self._stops
        link = await self._connected()
        if verb == "acquire":
            asked_s = fields.get("timeout_s", LEASE_S)
            if isinstance(asked_s, int | float) and asked_s > MAX_LEASE_S:
                return refusal(Code.BAD_REQUEST, f"timeout_s: at most {MAX_LEASE_S:g} s by network")
            fields = {**fields, "timeout_s": asked_s}
        if verb == GREETING:
            if "by" in fields:
                return refusal(Code.BAD_REQUEST, "by: it is the operator, and part of the key")
            fields = {**fields, "by": self._origin.operator}
        if verb in LEASED:
            lease = (await link.result("status"))["lease"]
            if lease.get("client") != self._number:
                return refusal(NO_LEASE, "this session does not hold the lease; acquire it first")
            if self._stops != stops:
                return refusal(Code.STOPPED, "this session stopped the robots before the order was sent")
        if verb == "rows" and self._rows.is_live(fields):
            return await self._rows.follow(link, fields)
        if verb == "end":
            await self._rows.settled()
        response = await link.request(verb, fields)
        if verb == "move" and response.get("ok"):
            self._rows.begun(response["result"])
        return response

    async def _connected(self) -> DaemonLink:
        async with self._connecting:
            if self._link is not None and self._link.open:
                return self._link
            link = DaemonLink(self._path, self._take, lambda: self._rows.clear("the daemon ended"))
            await link.connect()
            greeting: Fields = {"name": f"fleet {self._origin.operator}"}
            if link.same_protocol:
                greeting = {"protocol": PROTOCOL, "name": "fleet", "by": self._origin.operator}
            try:
                self._number = int((await link.result("hello", **greeting))["client"])
                if self._closed:  # the session ended meanwhile: it must not acquire anything
                    raise ConnectionLostError("the session of this operator ended")
            except BaseException:
                link.close()
                raise
            self._link = link
            return link

    def _take(self, line: bytes, fields: Fields | None) -> None:
        if fields is not None:
            self._rows.notice(fields)
        self._noticed(line, fields is not None)


class _LiveRows:
    """Rows of live streams: those that are granted go on at once, and of the others the newest waits."""

    def __init__(self) -> None:
        self._granted: dict[int, int] = {}
        self._sent: dict[int, int] = {}
        self._waiting: tuple[int, Fields, asyncio.Future[Fields]] | None = None
        self._newest: asyncio.Future[Fields] | None = None
        self._link: DaemonLink | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def is_live(self, fields: Fields) -> bool:
        """True for one row of a live stream; anything else goes to the daemon as it is."""
        rows, move = fields.get("rows"), fields.get("move")
        return isinstance(move, int) and move in self._granted and isinstance(rows, list) and len(rows) == 1

    def begun(self, result: Fields) -> None:
        """Note the response to a `move`."""
        if result.get("granted") and not result.get("timed"):
            move = int(result["move"])
            self._granted[move], self._sent[move] = int(result["granted"]), 0

    def notice(self, fields: Fields) -> None:
        """Note credit, and streams that ended."""
        move = fields.get("move")
        if fields["event"] == "credit" and move in self._granted:
            self._granted[move] = max(self._granted[move], int(fields["granted"]))
        elif fields["event"] == "move" and move in self._granted:
            del self._granted[move]
        self._pump()

    async def follow(self, link: DaemonLink, fields: Fields) -> Fields:
        """Send a row when it is granted; the row that waited before is answered `superseded`."""
        self._link = link
        self._supersede("a newer row came before this one was sent")
        future: asyncio.Future[Fields] = asyncio.get_running_loop().create_future()
        self._newest = future
        self._waiting = int(fields["move"]), fields, future
        self._pump()
        return await future

    async def settled(self) -> None:
        """Wait for the newest row: the end of its stream must not overtake it."""
        if self._newest is not None:
            await asyncio.wait([self._newest])

    def clear(self, message: str) -> None:
        """Forget every stream."""
        self._granted.clear()
        self._supersede(message)

    def _supersede(self, message: str) -> None:
        if self._waiting is not None:
            future = self._waiting[2]
            self._waiting = None
            if not future.done():
                future.set_result(refusal(Code.SUPERSEDED, message))

    def _pump(self) -> None:
        if self._waiting is None or self._link is None:
            return
        move, fields, future = self._waiting
        # A stream that ended: the daemon refuses the row with its reason.
        if move in self._granted and self._sent[move] >= self._granted[move]:
            return
        self._waiting = None
        self._sent[move] = self._sent.get(move, 0) + 1
        task = asyncio.create_task(self._send(self._link, move, fields, future))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _send(
        self, link: DaemonLink, move: int, fields: Fields, future: asyncio.Future[Fields]
    ) -> None:
        try:
            response = await link.request("rows", fields)
            if response.get("error", {}).get("code") == Code.NO_CREDIT:  # not spent: wait for a notice
                self._sent[move] -= 1
                if move in self._granted:
                    self._granted[move] = min(self._granted[move], self._sent[move])
            elif move in self._granted and response.get("ok"):
                self._granted[move] = max(self._granted[move], int(response["result"]["granted"]))
        except ConnectionLostError as error:
            response = refusal(Code.NO_ANSWER, str(error))
        if not future.done():
            future.set_result(response)
        self._pump()
