"""A client's connection to a node over the network, in place of the socket of a daemon.

A request is sent as a query of Zenoh, and its answer is delivered as a line such as the socket has. A bridge
gives no free lease to an order that comes by network. Therefore the wire, in the program of the operator,
acquires it first, except after a stop by another client.

Set-points of `servo` go through `contid_fleet.links.row_pipeline`. Rows of `stream` are pipelined by the
client, up to the number that the daemon has granted, and none is dropped.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

from contid.remote.client.client_protocol import Request
from contid.remote.protocol.wire import Code, Fields, decode, encode
from contid_fleet.links.operator_link import LEASE_S, NO_LEASE
from contid_fleet.links.row_pipeline import RowPipeline
from contid_fleet.operator import FleetOperator, response_of
from contid_fleet.rights import LEASED, STOPS

#: Longest wait for an answer; the bridge answers by itself when the daemon does not [s].
ANSWER_TIMEOUT_S: Final = 5.0
#: First bytes of the notice that a move ended.
MOVE_ENDED: Final = b'{"event":"move"'
#: The only order that keeps the lease which it acquired; others release it.
KEEPING: Final = "move"


class FleetWire:
    """A client of one node (`contid.remote.client.wires.Wire`). Answers come in threads of Zenoh.

    Args:
        operator: the session.
        node: name of the node.
        deliver: gets lines, and b"" when the connection has ended.
        owns: `close` ends the session.
    """

    def __init__(
        self,
        operator: FleetOperator,
        node: str,
        deliver: Callable[[bytes], None],
        owns: bool = False,
    ) -> None:
        self._operator = operator
        self._node = node
        self._deliver = deliver
        self._owns = owns
        self._client: int | None = None
        self._ended = self._closed = False
        self._lock = threading.Lock()
        self._stream: RowPipeline | None = None
        self._ended_moves: set[int] = set()
        key = operator.keys.notices(node, operator.origin.operator, operator.origin.session)
        self._notices = operator.net.subscribe(key, lambda _, line: self._notice(line))
        self._leaving = operator.on_leave(node, lambda: self._end(f"{node}: its bridge or daemon is gone"))

    def send(self, request: Request) -> None:
        """Send a request; its response is delivered as a line (`contid.remote.client.wires.Wire.send`)."""
        move = request.fields.get("move") or 0
        if request.newest and move not in self._ended_moves:
            if self._stream is None or self._stream.move != move:
                self._stream = RowPipeline(move, self._ask, self._respond)
            self._stream.follow(request)
            return
        if request.verb == "end" and self._stream is not None and self._stream.move == move:
            self._stream.end(request)
            return

        def answered(response: Fields) -> None:
            if response.get("error", {}).get("code") == NO_LEASE and request.verb in LEASED:
                self._acquire(request, response)
            else:
                self._respond(request, response)

        self._ask(request.verb, request.fields, request.timeout_s, answered)

    def close(self) -> None:
        """End the connection, without a release: if it held the lease, the robots hold."""
        with self._lock:
            if self._closed:
                return
            self._closed = self._ended = True
        self._leaving()
        if self._owns:
            self._operator.close()
        else:
            self._notices.end()

    def _acquire(self, request: Request, refusal: Fields) -> None:
        """Take a free lease, and order again."""
        after_stop = bool(request.fields.get("after_stop"))
        fields = {"timeout_s": LEASE_S, "unless_stopped": not after_stop}

        def ordered(response: Fields) -> None:
            if request.verb != KEEPING or not response.get("ok"):
                self._ask("release", {}, request.timeout_s, lambda _: self._respond(request, response))
            else:
                self._respond(request, response)

        def acquired(response: Fields) -> None:
            if response.get("ok"):
                self._ask(request.verb, request.fields, request.timeout_s, ordered)
            else:
                self._respond(request, response)

        self._ask("acquire", fields, request.timeout_s, acquired)

    def _ask(
        self,
        verb: str,
        fields: Mapping[str, Any],
        timeout_s: float,
        answered: Callable[[Fields], None],
        newest: bool = False,
    ) -> None:
        """Send a query to the node; ``answered`` is called exactly once, or the connection ends.

        Args:
            verb: of the request.
            fields: of the request.
            timeout_s: without an answer for this time the connection ends; at most `ANSWER_TIMEOUT_S`, but
                for ``end``.
            answered: gets the response, in a thread of Zenoh.
            newest: a lost request does not end the connection, because the next one takes its place.
        """
        is_answered = False

        def take(_: str, payload: bytes) -> None:
            nonlocal is_answered
            if not is_answered:
                is_answered = True
                response = response_of(payload)
                if self._is_same(response.pop("client", None)):
                    answered(response)

        def done() -> None:
            if is_answered or self._ended:
                return
            if newest:  # dropped where a link is full
                answered({"ok": False, "error": {"code": Code.SUPERSEDED, "message": "lost on the way"}})
            else:
                self._end(
                    f"{self._node}: no response to {verb} within {timeout_s:g} s (a machine with TLS answers "
                    "nothing that its file does not allow this operator)"
                )

        if verb != "end":  # the bridge answers it after the last row, which may wait for the daemon
            timeout_s = min(timeout_s, ANSWER_TIMEOUT_S)
        self._operator.net.ask(
            self._operator.key(self._node, verb),
            encode(fields)[:-1],
            timeout_s,
            take,
            done,
            urgent=verb in STOPS,
            wait=not newest,
        )

    def _is_same(self, number: int | None) -> bool:
        """True when the bridge still has the same connection to the daemon for this client.

        Another number is that of a new connection, which has neither the lease nor the moves.
        """
        if number is None:
            return True
        if self._client is None:
            self._client = number
        if self._client != number:
            self._end(f"{self._node}: its bridge or its daemon lost this session")
        return self._client == number

    def _notice(self, line: bytes) -> None:
        if line.startswith(MOVE_ENDED):  # further rows are refused with the reason
            self._ended_moves.add(int(decode(line)["move"]))
        self._deliver(line + b"\n")

    def _respond(self, request: Request, response: Fields) -> None:
        self._deliver(encode({"id": request.number, **response}))

    def _end(self, message: str) -> None:
        with self._lock:
            if self._ended:
                return
            self._ended = True
        self._deliver(encode({"event": "bye", "message": message}))
        self._deliver(b"")
