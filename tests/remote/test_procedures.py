"""The procedures of a client over a connection in memory, and how both clients derive from them."""

from __future__ import annotations

import inspect
import math
from collections.abc import AsyncIterator, Awaitable, Generator
from pathlib import Path

import pytest

from contid.client import AsyncClient, Client
from contid.remote.client.client_protocol import Request
from contid.remote.client.procedures import Procedures
from contid.remote.client.sync_client import completed
from contid.remote.protocol.wire import Fields, RemoteError, decode, encode


class MemoryConnection(Procedures):
    """A link with latency: responses to rows come with the next wait, and then rows are granted again.

    Args:
        timed: rows have times.
        credits: granted at the begin of a stream, and for every row that has been responded to.
    """

    def __init__(self, timed: bool, credits: int) -> None:
        super().__init__()
        self.timed, self.credits = timed, credits
        self.batches: list[int] = []
        self.under_way: list[Request] = []
        self.waits = self.answered = self.most_under_way = 0
        self.refuse: int | None = None

    async def _open(self, path: Path) -> None: ...

    async def _disconnect(self) -> None: ...

    async def _sleep(self, seconds: float) -> None: ...

    async def _wait_notice(self, seconds: float) -> None:
        if seconds < 0.1:  # a look: nothing has come yet
            return
        self.waits += 1
        while self.under_way:
            request = self.under_way.pop(0)
            self.answered += len(request.fields["rows"])
            if self.answered == self.refuse:
                error = {"code": "stopped", "message": "another client held"}
                self._protocol.receive(encode({"id": request.number, "ok": False, "error": error}))
                continue
            result = {
                **self._credit(),
                "refused": [f"rows:{self.answered}"] if self.answered % 50 == 0 else [],
            }
            self._protocol.receive(encode({"id": request.number, "ok": True, "result": result}))

    async def _post(self, request: Request) -> None:
        self.under_way.append(request)
        self.batches.append(len(request.fields["rows"]))
        self.most_under_way = max(self.most_under_way, len(self.under_way))
        assert sum(self.batches) <= self._granted(), "never more than was granted"

    async def _exchange(self, request: Request) -> Fields:
        verb = str(decode(request.line)["verb"])
        result: Fields = {}
        if verb == "move":
            result = {"move": 1, "timed": self.timed, **self._credit()}
        if verb == "end":
            assert not self.under_way, "the end comes after every response"
            self._protocol.receive(encode({"event": "move", "move": 1, "reached": True, "message": ""}))
        self._protocol.receive(encode({"id": request.number, "ok": True, "result": result}))
        return self._protocol.result(request) or {}

    def _granted(self) -> int:
        return 50_000 if self.timed else self.answered + self.credits

    def _credit(self) -> Fields:
        return {"credits": self.credits, "granted": self._granted()}


@pytest.mark.parametrize(
    ("timed", "credits", "count", "under_way", "waits"),
    [(False, 8, 100, 8, 13), (False, 1, 100, 1, 100), (True, 1024, 100, 1, 1), (True, 1024, 10_000, 16, 3)],
)
def test_as_many_rows_are_under_way_as_are_granted(
    timed: bool, credits: int, count: int, under_way: int, waits: int
) -> None:
    """With a response awaited for every request there were 100 waits, and 40 for 10 000 rows."""
    connection = MemoryConnection(timed, credits)
    refused = completed(connection.stream(["x_mm"], [(float(number),) for number in range(count)]))
    assert sum(connection.batches) == count
    assert max(connection.batches) == (min(count, 256) if timed else 1)
    assert connection.most_under_way == under_way
    assert connection.waits == waits
    if not timed:
        assert refused == ["rows:50", "rows:100"]


def test_a_refusal_of_a_row_under_way_ends_the_stream() -> None:
    connection = MemoryConnection(False, 8)
    connection.refuse = 20
    with pytest.raises(RemoteError, match="another client held"):
        completed(connection.stream(["x_mm"], [(0.0,)] * 100))
    assert sum(connection.batches) < 30
    assert not connection._protocol._open, "the responses that still come are dropped"


def test_more_timed_rows_than_a_daemon_takes_are_refused_by_it() -> None:
    """Their credit never grows: a client that waited for more waited for ever."""

    class Full(MemoryConnection):
        async def _wait_notice(self, seconds: float) -> None:
            assert self.waits < 1000, "waits for rows that are never granted"
            await super()._wait_notice(seconds)

        async def _post(self, request: Request) -> None:
            self.under_way.append(request)

    connection = Full(True, 1024)
    connection.refuse = 50_176  # the first whole batch beyond 50 000 rows
    with pytest.raises(RemoteError, match="another client held"):
        completed(connection.stream(["t_s", "x_mm"], [(0.0, 0.0)] * 60_000))


class SleepyConnection(MemoryConnection):
    """Begin and end of a short motion are read at once: the client did something else meanwhile."""

    async def _wait_notice(self, seconds: float) -> None:
        self.waits += 1
        assert self.waits == 1, "nothing more will come"
        begun = {"event": "started", "move": 3, "tick": 70, "at_s": 1.0, "began_s": 1.0}
        self._protocol.receive(encode(begun) + encode({"event": "move", "move": 3, "reached": True}))


def test_a_motion_that_began_and_ended_before_the_client_looked_is_over() -> None:
    """`started` took the end for its own, and `wait` waited for another without end."""
    client = SleepyConnection(timed=True, credits=1)
    client._protocol.requested_s = math.inf  # no request is due
    assert completed(client.started(3))["tick"] == 70
    completed(client.wait(3))


def test_asynchronous_rows_are_refused_by_a_blocking_client() -> None:
    class Suspend:
        def __await__(self) -> Generator[None, None, None]:
            yield

    async def rows(pause: Awaitable[None]) -> AsyncIterator[tuple[float]]:
        await pause
        yield (1.0,)

    with pytest.raises(RuntimeError, match="AsyncClient"):
        completed(MemoryConnection(False, 8).stream(["x_mm"], rows(Suspend())))


def test_the_blocking_client_has_every_procedure_with_its_parameters() -> None:
    public = {name for name in dir(Procedures) if not name.startswith("_")} - {"connect"}
    assert public <= vars(Client).keys()
    for name in public:
        blocking = inspect.signature(getattr(Client, name)).parameters
        assert list(blocking) == list(inspect.signature(getattr(AsyncClient, name)).parameters), name
        assert getattr(Client, name).__doc__
        assert not inspect.iscoroutinefunction(getattr(Client, name))
