"""Set-points of one stream over the network, several under way at a time.

So their rate is not bound by the round trip. One that a full link drops is superseded by the next.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from contid.remote.client.client_protocol import Request
from contid.remote.protocol.wire import Code, Fields
from contid_fleet.links.operator_link import LEASE_S

#: A set-point that is not answered for so long was lost on the way, or its answer was [s]. The end of the
#: stream waits for it meanwhile, and nothing else refreshes the lease.
LOST_AFTER_S: Final = 0.5 * LEASE_S
#: Set-points that are not yet answered; a further one waits for an answer.
MAX_UNANSWERED: Final = 16


class RowPipeline:
    """The set-points of one stream. Requests come from one thread, answers from those of Zenoh.

    A row is responded to at once while less than `MAX_UNANSWERED` are under way. A refusal in its answer
    comes with the response to a later row, or to the end of the stream.

    Args:
        move: number of the stream.
        ask: sends a request.
        respond: gives the client the response to one.
    """

    def __init__(
        self,
        move: int,
        ask: Callable[[str, Mapping[str, Any], float, Callable[[Fields], None], bool], None],
        respond: Callable[[Request, Fields], None],
    ) -> None:
        self.move = move
        self._ask = ask
        self._respond = respond
        self._lock = threading.Lock()
        self._unanswered = 0
        self._refused: deque[list[str]] = deque()
        self._error: Fields | None = None
        self._waiting: Request | None = None

    def follow(self, request: Request) -> None:
        """Send a row."""
        with self._lock:
            self._unanswered += 1
        self._ask("rows", request.fields, min(request.timeout_s, LOST_AFTER_S), self._answered, True)
        self._settle(request)

    def end(self, request: Request) -> None:
        """Send the end of the stream, once every row is answered or lost."""
        self._settle(request)

    def _answered(self, response: Fields) -> None:
        with self._lock:
            self._unanswered -= 1
            if response.get("ok"):
                if refused := response["result"].get("refused"):
                    self._refused.append(refused)
            elif response["error"]["code"] != Code.SUPERSEDED:
                self._error = self._error or response
            waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._settle(waiting)

    def _settle(self, request: Request) -> None:
        """Respond to a row, or send the end, if it need not wait for an answer."""
        ends = request.verb == "end"
        with self._lock:
            if self._error is None and self._unanswered >= (1 if ends else MAX_UNANSWERED):
                self._waiting = request
                return
            error, self._error = self._error, None
            refused = self._refused.popleft() if self._refused and not ends else []
            if ends:
                refused = [message for each in self._refused for message in each]
        if error is not None:
            self._respond(request, error)
        elif not ends:
            self._respond(request, {"ok": True, "result": {"refused": refused}})
        else:
            ended = partial(self._ended, request, refused)
            self._ask("end", request.fields, request.timeout_s, ended, False)

    def _ended(self, request: Request, refused: list[str], response: Fields) -> None:
        if response.get("ok"):
            response = {**response, "result": {**response["result"], "refused": refused}}
        self._respond(request, response)
