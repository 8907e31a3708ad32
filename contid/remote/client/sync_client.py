"""The blocking client for scripts and notebooks, derived from the procedures; see `contid.client`."""

from __future__ import annotations

import functools
import time
from collections import deque
from collections.abc import Callable, Coroutine, Generator, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, Final, ParamSpec, Self, TypeVar

from contid.remote.client.client_protocol import RESPONSE_TIMEOUT_S, Request
from contid.remote.client.orders import Robots
from contid.remote.client.procedures import Procedures, measured_tip
from contid.remote.client.wires import Address, QueuedWire, SocketWire
from contid.remote.protocol.wire import ConnectionLostError, Fields, RemoteError

P = ParamSpec("P")
T = TypeVar("T")

#: How long to wait for the close reason of a daemon that takes no request any more.
CLOSE_REASON_TIMEOUT_S: Final = 0.5
#: Measured tips that may be on their way; one more waits for an answer.
MAX_UNANSWERED: Final = 32


class BlockingProcedures(Procedures):
    """The procedures over a blocking wire: no coroutine of this class ever suspends."""

    _wire: SocketWire | QueuedWire | None = None

    async def track(
        self,
        tip_mm: Sequence[float],
        time_s: float,
        *,
        direction: Sequence[float] | None = None,
        robot: str | None = None,
    ) -> list[RemoteError]:
        """Send a measured tip as `measure` does, without waiting for its answer.

        Args:
            tip_mm: position in the world frame, ``(x, y, z)``.
            time_s: time of the capture, by `time.monotonic` on this machine.
            direction: of the body at its tip, in the world frame; its length does not matter.
            robot: its name; may be left out when there is only one.

        Returns:
            What the daemon refused of the tips before, as far as it has answered.
        """
        tip = measured_tip(tip_mm, direction, robot, time_s)
        request = self._protocol.request("measure", tip, newest=True)
        await self._post(request)
        self._unanswered.append(request)
        self._read(0.0)
        refused: list[RemoteError] = []
        deadline_s = time.monotonic() + request.timeout_s
        while self._unanswered:
            try:
                if self._protocol.result(self._unanswered[0]) is None:
                    if len(self._unanswered) <= MAX_UNANSWERED:
                        break
                    if time.monotonic() > deadline_s:
                        raise self._protocol.lost(f"no response within {request.timeout_s:g} s")
                    self._read(0.1)
                    continue
            except RemoteError as error:
                refused.append(error)
            self._unanswered.popleft()
        return refused

    async def _open(self, path: Path) -> None:
        self._unanswered: deque[Request] = deque()
        if self._address is not None:
            self._wire = QueuedWire(self._address)
        else:
            self._wire = SocketWire(path, self._protocol.timeout_s)

    async def _exchange(self, request: Request) -> Fields:
        deadline_s = time.monotonic() + request.timeout_s
        await self._post(request)
        while (result := self._protocol.result(request)) is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                raise self._protocol.lost(f"no response within {request.timeout_s:g} s")
            self._read(left_s)
        return result

    async def _post(self, request: Request) -> None:
        assert self._wire is not None
        try:
            self._wire.send(request)
        except OSError as error:
            self._read_close_reason()
            raise self._protocol.lost(f"the connection ended ({error.strerror or error})") from None

    async def _wait_notice(self, seconds: float) -> None:
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self._read(left_s):
                return

    async def _sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    async def _disconnect(self) -> None:
        if self._wire is not None:
            self._wire.close()

    def _read(self, timeout_s: float) -> bool:
        """Read once, waiting at most ``timeout_s``; True when a notice came."""
        assert self._wire is not None
        try:
            chunk = self._wire.receive(timeout_s)
        except OSError as error:
            raise self._protocol.lost(f"the connection ended ({error.strerror or error})") from None
        if chunk is None:
            return False
        if not chunk:
            raise self._protocol.lost("the daemon closed the connection")
        return self._protocol.receive(chunk)

    def _read_close_reason(self) -> None:
        deadline_s = time.monotonic() + CLOSE_REASON_TIMEOUT_S
        with suppress(ConnectionLostError):
            while not self._protocol.close_reason and (left_s := deadline_s - time.monotonic()) > 0.0:
                self._read(left_s)


def completed(coroutine: Coroutine[Any, Any, T]) -> T:
    """The result of a coroutine that never suspends."""
    try:
        coroutine.send(None)
    except StopIteration as stop:
        result: T = stop.value
        return result
    coroutine.close()
    raise RuntimeError("asynchronous rows need AsyncClient")


def _blocking(
    procedure: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[Client, P], T]:
    """A procedure as a blocking method, with its signature and documentation."""

    @functools.wraps(procedure)
    def call(client: Client, /, *args: P.args, **keys: P.kwargs) -> T:
        return completed(procedure(client._procedures, *args, **keys))

    return call


class Client:
    """A connection to a daemon. Not thread-safe: each thread needs its own.

    Args:
        path: path of the socket, or an address (``fleet:FLEET/NODE``); None for the only running daemon.
        name: name of this client in the daemon's messages.
        timeout_s: how long to wait for a response.
        valid_s: how long after they are given orders may be carried out, where the daemon is on this machine;
            None for ``timeout_s``: what has failed for its caller moves nothing later.

    Attributes:
        path: path of the socket, or the address.
        name: name of this client.
        hello: the daemon's greeting: protocol, version, name, number of this client.

    Raises:
        NoDaemonError: no daemon there, or several and no path.
    """

    def __init__(
        self,
        path: str | Path | Address | None = None,
        *,
        name: str | None = None,
        timeout_s: float = RESPONSE_TIMEOUT_S,
        valid_s: float | None = None,
    ) -> None:
        self._procedures = BlockingProcedures(path, name=name, timeout_s=timeout_s, valid_s=valid_s)
        completed(self._procedures.connect())
        self.path = self._procedures.path
        self.name = self._procedures.name
        self.hello = self._procedures.hello

    request = _blocking(Procedures.request)
    status = _blocking(Procedures.status)
    describe = _blocking(Procedures.describe)
    ping = _blocking(Procedures.ping)
    hold = _blocking(Procedures.hold)
    stop = _blocking(Procedures.stop)
    estop = _blocking(Procedures.estop)
    clear_fault = _blocking(Procedures.clear_fault)
    grip = _blocking(Procedures.grip)
    recover = _blocking(Procedures.recover)
    resume = _blocking(Procedures.resume)
    acquire = _blocking(Procedures.acquire)
    release = _blocking(Procedures.release)
    record = _blocking(Procedures.record)
    move = _blocking(Procedures.move)
    start = _blocking(Procedures.start)
    started = _blocking(Procedures.started)
    wait = _blocking(Procedures.wait)
    servo = _blocking(Procedures.servo)
    measure = _blocking(Procedures.measure)
    track = _blocking(BlockingProcedures.track)
    close = _blocking(Procedures.close)

    def stream(
        self, columns: Sequence[str], rows: Iterable[Sequence[float]], *, wait: bool = True
    ) -> list[str]:
        """Follow rows; see `Procedures.stream`."""
        return completed(self._procedures.stream(columns, rows, wait=wait))

    def load(self, columns: Sequence[str], rows: Iterable[Sequence[float]]) -> int:
        """Send and check a timed trajectory; see `Procedures.load`."""
        return completed(self._procedures.load(columns, rows))

    def telemetry(
        self,
        rate_hz: float = 20.0,
        *,
        robots: Robots = None,
        fields: Sequence[str] | None = None,
        events: bool = False,
    ) -> Generator[Fields, None, None]:
        """Frames as they come, without end; see `Procedures.telemetry`."""
        frames = self._procedures.telemetry(rate_hz, robots=robots, fields=fields, events=events)
        try:
            while True:
                yield completed(frames.__anext__())
        finally:
            completed(frames.aclose())

    def __enter__(self) -> Self:
        """Close on leaving."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close; after an error without releasing the lease, so that the robots hold."""
        if kind is None:
            self.close()
        else:
            completed(self._procedures._disconnect())
