"""The procedures of a client over a connection in memory, and how both clients derive from them."""

from __future__ import annotations

import inspect
from collections.abc import AsyncIterator, Awaitable, Generator
from pathlib import Path

import pytest

from contid.client import AsyncClient, Client
from contid.remote.client.client_protocol import Request
from contid.remote.client.procedures import Procedures
from contid.remote.client.sync_client import completed
from contid.remote.protocol.wire import Fields, decode, encode


class MemoryConnection(Procedures):
    """Grants ``credits`` rows at the begin of a stream, and as many at every notice."""

    def __init__(self, timed: bool, credits: int) -> None:
        super().__init__()
        self.timed, self.credits = timed, credits
        self.batches: list[int] = []
        self.notices = 0

    async def _open(self, path: Path) -> None: ...

    async def _disconnect(self) -> None: ...

    async def _sleep(self, seconds: float) -> None: ...

    async def _wait_notice(self, seconds: float) -> None:
        self.notices += 1
        self._protocol.receive(encode({"event": "credit", "move": 1, "credits": self.credits}))

    async def _exchange(self, request: Request) -> Fields:
        result = self._result(str(decode(request.line)["verb"]), request)
        self._protocol.receive(encode({"id": request.number, "ok": True, "result": result}))
        return self._protocol.result(request) or {}

    def _result(self, verb: str, request: Request) -> Fields:
        match verb:
            case "move":
                return {"move": 1, "timed": self.timed, "credits": self.credits}
            case "rows":
                self.batches.append(len(request.fields["rows"]))
                assert self.batches[-1] <= self._protocol.credits[1], "never more than was granted"
                left = self.credits if self.timed else self._protocol.credits[1] - self.batches[-1]
                return {"credits": left, "refused": []}
            case "end":
                self._protocol.receive(encode({"event": "move", "move": 1, "reached": True, "message": ""}))
        return {}


@pytest.mark.parametrize(("timed", "credits", "notices"), [(False, 8, 12), (False, 1, 99), (True, 1024, 0)])
def test_rows_are_sent_under_credit(timed: bool, credits: int, notices: int) -> None:
    connection = MemoryConnection(timed, credits)
    assert completed(connection.stream(["x_mm"], [(float(number),) for number in range(100)])) == []
    assert connection.batches == ([100] if timed else [1] * 100)
    assert connection.notices == notices


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
