"""The client side of the protocol without I/O: requests to bytes, bytes to results and notices.

A client may send as many rows of a move as the daemon has granted (its credit). Lines take effect in order of
arrival: the credit of a move is that of the newest line, whether response or notice.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from contid.remote.protocol.expiry import FIELD, LASTING, clock_s
from contid.remote.protocol.wire import (
    PROTOCOL,
    STOP_VERBS,
    Code,
    ConnectionLostError,
    Fields,
    RemoteError,
    decode,
    encode,
)

#: Frames and events that wait for iteration; older ones are dropped.
MAX_WAITING: Final = 4096
#: Bytes of one read.
CHUNK: Final = 1 << 16
#: Seconds to wait for a response, unless the client chose another time.
RESPONSE_TIMEOUT_S: Final = 10.0
#: Verbs that take longer: a trajectory of 50 000 rows is checked row by row.
VERB_TIMEOUT_S: Final = {"end": 120.0}


@dataclass(frozen=True, slots=True)
class Request:
    """A request to send.

    Attributes:
        number: its ``id``, repeated in the response.
        verb: what it asks.
        line: its bytes.
        timeout_s: how long to wait for the response.
        fields: without ``id`` and ``verb``.
        newest: a row of which only the newest counts; a wire with latency may respond before the daemon.
    """

    number: int
    verb: str
    line: bytes
    timeout_s: float
    fields: Mapping[str, Any]
    newest: bool = False


class ClientProtocol:
    """The state of one connection.

    Attributes:
        frames: telemetry and events, in their order.
        credits: rows that may be sent now, by number of the move.
        granted: rows that may be sent in all, those that were sent included, by number of the move.
        started: tick and times of the start of trajectories that waited, by number of the move.
        close_reason: the daemon's reason to end the connection, "" before.
        greeting: the daemon's first line, empty before.
        foreign: why the daemon only stops robots for this client: it has another protocol; "" otherwise.
        requested_s: time of the last request; requests keep the lease.
        timeout_s: how long to wait for a response.
    """

    def __init__(self, timeout_s: float = RESPONSE_TIMEOUT_S, valid_s: float | None = None) -> None:
        """Begin.

        Args:
            timeout_s: how long to wait for a response.
            valid_s: how long after it is made a request may be carried out; None for ever: the daemon is on
                another machine, whose clock is not ours.
        """
        self.frames: deque[Fields] = deque(maxlen=MAX_WAITING)
        self.credits: dict[int, int] = {}
        self.granted: dict[int, int] = {}
        self.started: dict[int, Fields] = {}
        self.close_reason = ""
        self.greeting: Fields = {}
        self.foreign = ""
        self.requested_s = 0.0
        self.timeout_s = timeout_s
        self._valid_s = valid_s
        self._number = 0
        self._open: dict[int, Request] = {}
        self._responses: dict[int, Fields] = {}
        self._ended: dict[int, Fields] = {}
        self._partial = b""

    def request(self, verb: str, fields: Mapping[str, Any], newest: bool = False) -> Request:
        """The next request; fields that are None are left out.

        Raises:
            RemoteError: the daemon has another protocol, and this is no order to stop.
        """
        self._check_protocol(verb)
        self._number += 1
        self.requested_s = time.monotonic()
        given = {key: value for key, value in fields.items() if value is not None}
        if self._valid_s is not None and verb not in LASTING and FIELD not in given:
            given[FIELD] = clock_s() + self._valid_s
        timeout_s = max(self.timeout_s, VERB_TIMEOUT_S.get(verb, 0.0))
        line = encode({"id": self._number, "verb": verb, **given})
        request = self._open[self._number] = Request(self._number, verb, line, timeout_s, given, newest)
        return request

    def receive(self, chunk: bytes) -> bool:
        """Take in bytes; True when they completed a notice, or the response to rows.

        Raises:
            RemoteError: the daemon has no protocol.
        """
        *lines, self._partial = (self._partial + chunk).split(b"\n")
        noticed = False
        for line in lines:
            fields = decode(line)
            if "event" in fields:
                self._notice(fields)
                noticed = True
            else:
                noticed |= self._response(fields) == "rows"
        return noticed

    def result(self, request: Request) -> Fields | None:
        """The result of a request, None before its response.

        Raises:
            RemoteError: the daemon refused, or has another protocol and this is no order to stop.
        """
        self._check_protocol(request.verb)
        response = self._responses.pop(request.number, None)
        if response is None:
            return None
        if response.get("ok"):
            result: Fields = response["result"]
            return result
        raise RemoteError.of(response.get("error", {}))

    def forget(self, request: Request) -> None:
        """Discard the response of a request, now or when it arrives."""
        self._open.pop(request.number, None)
        self._responses.pop(request.number, None)

    def new_frames(self) -> Iterator[Fields]:
        """Remove and yield the waiting telemetry and events."""
        while self.frames:
            yield self.frames.popleft()

    def arrived(self, move: int) -> bool:
        """True when a move reached its end, False while it goes on.

        Raises:
            RemoteError: it was stopped before.
        """
        ended = self._ended.pop(move, None)
        if ended is None:
            return False
        if not ended["reached"]:
            faults = ended.get("faults")
            message = str(ended["message"]) or "the move ended before its target"
            raise RemoteError(Code.FAULT if faults else Code.STOPPED, message, faults)
        return True

    def lost(self, message: str) -> ConnectionLostError:
        """The error of a connection that ended; the daemon's own reason comes first."""
        return ConnectionLostError(f"{self.close_reason or message}; robots that this client moved hold")

    def _response(self, fields: Fields) -> str:
        """Take in a response; returns the verb of its request, "" of one that was forgotten."""
        # Without a number it refers to an unreadable line: the newest request.
        number = fields.get("id") or max(self._open, default=0)
        request = self._open.pop(number, None)
        if request is None:
            return ""
        self._responses[request.number] = fields
        result = fields.get("result", {})
        if "credits" in result:
            self._grant(int(result.get("move") or request.fields["move"]), result)
        return request.verb

    def _notice(self, fields: Fields) -> None:
        match fields["event"]:
            case "hello":
                self.greeting = fields
                if (theirs := fields.get("protocol")) != PROTOCOL:
                    self.foreign = (
                        f"the daemon has protocol {theirs}, this client {PROTOCOL}; update the older one "
                        f"(until then: {', '.join(STOP_VERBS)})"
                    )
            case "telemetry" | "event":
                self.frames.append(fields)
            case "move":
                self._ended[int(fields["move"])] = fields
                self.credits.pop(int(fields["move"]), None)
                self.granted.pop(int(fields["move"]), None)
            case "credit":
                self._grant(int(fields["move"]), fields)
            case "started":
                self.started[int(fields["move"])] = fields
            case "bye":
                self.close_reason = str(fields["message"])

    def _check_protocol(self, verb: str) -> None:
        """Refuse what another protocol may spell differently: all but an order to stop."""
        if self.foreign and verb not in STOP_VERBS:
            raise RemoteError(Code.PROTOCOL, self.foreign)

    def _grant(self, move: int, fields: Fields) -> None:
        self.credits[move] = int(fields["credits"])
        # By network a notice may come after a newer response; the sum never falls.
        self.granted[move] = max(self.granted.get(move, 0), int(fields.get("granted", 0)))
