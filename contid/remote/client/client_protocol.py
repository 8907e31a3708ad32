"""A client's side of the protocol without any I/O: requests to bytes, bytes to answers and notices.

Both clients give it what they read and send what it says, so both understand a daemon alike. What comes is
taken in its order: the credit of a move is always what the newest line said, be it an answer or a notice.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from contid.remote.protocol.wire import (
    PROTOCOL,
    Code,
    ConnectionLostError,
    Fields,
    RemoteError,
    decode,
    encode,
)

#: Frames and events that wait for whoever iterates; older ones are dropped.
MAX_WAITING: Final = 4096
#: Bytes that a client reads at a time.
CHUNK: Final = 1 << 16
#: Seconds to wait for an answer; a daemon that is silent for longer is not there.
ANSWER_S: Final = 10.0
#: Requests that are worked on for longer: a trajectory of 50 000 rows is checked row by row.
PATIENCE_S: Final = {"end": 120.0}


@dataclass(frozen=True, slots=True)
class Request:
    """A request that was asked.

    Attributes:
        number: its ``id``, which its answer bears.
        line: what goes to the daemon.
        patience_s: how long to wait for the answer.
        fields: what was asked with.
    """

    number: int
    line: bytes
    patience_s: float
    fields: Mapping[str, Any]


class ClientProtocol:
    """One connection, as far as it is words.

    Attributes:
        frames: telemetry and events, in their order.
        credits: rows that may be sent now, by number of the move.
        farewell: the last words of the daemon, "" before them.
        asked_s: when something was asked last: until then this client was heard of.
    """

    def __init__(self, timeout_s: float = ANSWER_S) -> None:
        self.frames: deque[Fields] = deque(maxlen=MAX_WAITING)
        self.credits: dict[int, int] = {}
        self.farewell = ""
        self.asked_s = 0.0
        self._timeout_s = timeout_s
        self._number = 0
        self._open: dict[int, Request] = {}
        self._answers: dict[int, Fields] = {}
        self._ended: dict[int, Fields] = {}
        self._rest = b""

    def ask(self, verb: str, fields: Mapping[str, Any]) -> Request:
        """The next request; fields that are None are left out."""
        self._number += 1
        self.asked_s = time.monotonic()
        given = {key: value for key, value in fields.items() if value is not None}
        patience_s = max(self._timeout_s, PATIENCE_S.get(verb, 0.0))
        line = encode({"id": self._number, "verb": verb, **given})
        request = self._open[self._number] = Request(self._number, line, patience_s, given)
        return request

    def receive(self, chunk: bytes) -> bool:
        """Take in what was read; True when a notice was in it.

        Raises:
            RemoteError: the daemon speaks another protocol, or none.
        """
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        noticed = False
        for line in lines:
            fields = decode(line)
            if "event" in fields:
                self._notice(fields)
                noticed = True
            else:
                self._answer(fields)
        return noticed

    def result(self, request: Request) -> Fields | None:
        """The result of a request, None before it was answered.

        Raises:
            RemoteError: the daemon refused.
        """
        answer = self._answers.pop(request.number, None)
        if answer is None:
            return None
        if answer.get("ok"):
            result: Fields = answer["result"]
            return result
        raise RemoteError.of(answer.get("error", {}))

    def forget(self, request: Request) -> None:
        """Nobody waits for an answer any more."""
        self._open.pop(request.number, None)
        self._answers.pop(request.number, None)

    def new_frames(self) -> Iterator[Fields]:
        """Telemetry and events that have come."""
        while self.frames:
            yield self.frames.popleft()

    def arrived(self, move: int) -> bool:
        """True when a move ended well, False while it goes on.

        Raises:
            RemoteError: it ended before its end.
        """
        told = self._ended.pop(move, None)
        if told is None:
            return False
        if not told["reached"]:
            faults = told.get("faults")
            message = str(told["message"]) or "the move ended before its target"
            raise RemoteError(Code.FAULT if faults else Code.STOPPED, message, faults)
        return True

    def gone(self, message: str) -> ConnectionLostError:
        """The error of a connection that ended."""
        return ConnectionLostError(f"{self.farewell or message}; robots that this client moved hold")

    def _answer(self, fields: Fields) -> None:
        # Without a number it is about a line that the daemon could not read: the newest one.
        number = fields.get("id") or max(self._open, default=0)
        request = self._open.pop(number, None)
        if request is None:  # nobody waits for it any more
            return
        self._answers[request.number] = fields
        result = fields.get("result", {})
        if "credits" in result:
            self.credits[int(result.get("move") or request.fields["move"])] = int(result["credits"])

    def _notice(self, fields: Fields) -> None:
        match fields["event"]:
            case "hello" if fields.get("protocol") != PROTOCOL:
                theirs = fields.get("protocol")
                message = f"the daemon has protocol {theirs}, this client {PROTOCOL}; update the older one"
                raise RemoteError(Code.PROTOCOL, message)
            case "telemetry" | "event":
                self.frames.append(fields)
            case "move":
                self._ended[int(fields["move"])] = fields
                self.credits.pop(int(fields["move"]), None)
            case "credit":
                self.credits[int(fields["move"])] = int(fields["credits"])
            case "bye":
                self.farewell = str(fields["message"])
