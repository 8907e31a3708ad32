"""The client for asyncio programs; see `contid.client`."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from contid.remote.client import procedures as steps
from contid.remote.client.client_protocol import ANSWER_S, CHUNK, ClientProtocol, Request
from contid.remote.client.procedures import Ask, Listen, Pause, Robots, RowSender, Steps, T, list_of
from contid.remote.protocol.socket_path import find
from contid.remote.protocol.wire import PROTOCOL, ConnectionLostError, Fields, NoDaemonError, RemoteError


class AsyncClient:
    """A connection to a daemon; several tasks may use it. Open it with ``async with``.

    The lease is kept only by requests and by awaiting a move or telemetry, never by a task in the
    background: a program that hangs shall lose it.

    Args:
        path: of the socket; None for the only daemon that runs.
        name: what the daemon calls this client in its messages.
        timeout_s: how long to wait for an answer.
    """

    def __init__(
        self, path: str | Path | None = None, *, name: str | None = None, timeout_s: float = ANSWER_S
    ) -> None:
        self._asked = None if path is None else str(path)
        self.name = name or f"{Path(sys.argv[0]).name or 'python'}[{os.getpid()}]"
        self._dialogue = ClientProtocol(timeout_s)
        self._waiting: dict[int, tuple[Request, asyncio.Future[Fields]]] = {}
        self._news = asyncio.Event()
        self._lost: ConnectionLostError | RemoteError | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._listener: asyncio.Task[None] | None = None

    async def connect(self) -> Self:
        """Connect; ``async with`` does it.

        Raises:
            NoDaemonError: no daemon there, or several and no path.
        """
        self.path = find(self._asked)
        try:
            reader, self._writer = await asyncio.open_unix_connection(self.path)
        except OSError as error:
            raise NoDaemonError(
                f"{self.path}: no daemon listens there ({error.strerror or error})"
            ) from error
        self._listener = asyncio.create_task(self._listen(reader))
        self.hello = await self.request("hello", protocol=PROTOCOL, name=self.name)
        return self

    async def request(self, verb: str, **fields: Any) -> Fields:
        """Send any request and wait for its result; see docs/remote.md for the verbs.

        Raises:
            RemoteError: the daemon refused.
            ConnectionLostError: it is gone.
        """
        if self._lost is not None or self._writer is None:
            raise self._lost or ConnectionLostError("not connected; use `async with`")
        asked = self._dialogue.ask(verb, fields)
        future: asyncio.Future[Fields] = asyncio.get_running_loop().create_future()
        self._waiting[asked.number] = asked, future
        try:
            self._writer.write(asked.line)
            with suppress(ConnectionError):
                await self._writer.drain()
            async with asyncio.timeout(asked.patience_s):
                return await future
        except TimeoutError:
            raise self._dialogue.gone(f"no answer within {asked.patience_s:g} s") from None
        finally:
            self._waiting.pop(asked.number, None)
            self._dialogue.forget(asked)

    async def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and who may move."""
        return await self.request("status")

    async def describe(self) -> Fields:
        """Robots, axes, limits, and the columns each understands."""
        return await self.request("describe")

    async def ping(self) -> None:
        """Show that this client is alive; keeps the lease."""
        await self.request("ping")

    async def hold(self, robots: Robots = None) -> Fields:
        """Stop with limited jerk and stay; everybody may."""
        return await self.request("hold", robots=list_of(robots))

    async def stop(self, robots: Robots = None, *, end: bool = False) -> Fields:
        """Stop by the robot file's ``stop.on_interrupt``; ``end`` ends the daemon too. Everybody may."""
        return await self.request("stop", robots=list_of(robots), end=end)

    async def estop(self, robots: Robots = None) -> Fields:
        """Relax or vent now; everybody may."""
        return await self.request("estop", robots=list_of(robots))

    async def clear_fault(self, robots: Robots = None) -> Fields:
        """Look at everything again and leave FAULT; never moves. `resume` arms."""
        return await self.request("clear_fault", robots=list_of(robots))

    async def resume(self, robots: Robots = None, *, wait: bool = True) -> Fields:
        """Arm if need be and go on with what was followed; waits until the robots are armed."""
        return await self._follow(steps.resume(robots, wait))

    async def acquire(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Acquire the lease; without a request for ``timeout_s`` it lapses and the robots hold."""
        return await self.request("acquire", timeout_s=timeout_s, takeover=takeover)

    async def release(self) -> bool:
        """Release the lease; a point that is under way is still reached."""
        return bool((await self.request("release"))["released"])

    async def move(self, target: Mapping[str, float], *, wait: bool = True) -> int:
        """Go to a point, jerk-limited, and hold there; see `contid.client.Client.move`."""
        return await self._follow(steps.move(self._dialogue, target, wait))

    async def stream(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
        *,
        wait: bool = True,
    ) -> list[str]:
        """Follow rows under the daemon's credit; see `contid.client.Client.stream`."""
        sender = RowSender(self._dialogue, columns)
        await self._follow(sender.begin())
        async for row in _each(rows):
            await self._follow(sender.add(row))
        await self._follow(sender.end(wait))
        return sender.refused

    async def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the lease meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        await self._follow(steps.arrival(self._dialogue, move))

    async def measure(
        self,
        tip_mm: Sequence[float],
        *,
        direction: Sequence[float] | None = None,
        robot: str | None = None,
        age_ms: float | None = None,
        time_s: float | None = None,
    ) -> Fields:
        """Say where a tracker sees the tip of a robot; see `contid.client.Client.measure`."""
        return await self.request("measure", **steps.measurement(tip_mm, direction, robot, age_ms, time_s))

    async def telemetry(
        self,
        rate_hz: float = 20.0,
        *,
        robots: Robots = None,
        fields: Sequence[str] | None = None,
        events: bool = False,
    ) -> AsyncIterator[Fields]:
        """Frames as they come, for ever; see `contid.client.Client.telemetry`."""
        await self.request("subscribe", **steps.subscription(rate_hz, robots, fields, events))
        try:
            while True:
                for frame in self._dialogue.new_frames():
                    yield frame
                await self._follow(steps.listen(self._dialogue))
        finally:
            if self._lost is None:
                await self.request("unsubscribe")
                self._dialogue.frames.clear()

    # -- inside --------------------------------------------------------------------------------------------

    async def _follow(self, procedure: Steps[T]) -> T:
        """Carry out a procedure."""
        result: Fields = {}
        try:
            step = next(procedure)
            while True:
                match step:
                    case Ask(verb, fields):
                        result = await self.request(verb, **fields)
                    case Pause(seconds):
                        await asyncio.sleep(seconds)
                    case Listen(seconds):
                        await self._hear(seconds)
                step = procedure.send(result)
        except StopIteration as stop:
            told: T = stop.value
            return told

    async def _hear(self, seconds: float) -> None:
        """Wait until a notice comes, so many seconds at most."""
        if self._lost is not None:
            raise self._lost
        self._news.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._news.wait()

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        """Sort what comes until the connection ends."""
        message = "the daemon closed the connection"
        try:
            while chunk := await reader.read(CHUNK):
                if self._dialogue.receive(chunk):
                    self._news.set()
                for asked, future in self._waiting.values():
                    self._pass_on(asked, future)
        except RemoteError as error:
            self._lost = error
        except OSError as error:
            message = f"the connection ended ({error})"
        self._lost = self._lost or self._dialogue.gone(message)
        for _, future in self._waiting.values():
            if not future.done():
                future.set_exception(self._lost)
        self._news.set()

    def _pass_on(self, asked: Request, future: asyncio.Future[Fields]) -> None:
        """Give an answer, if it is there, to whoever waits for it."""
        if future.done():
            return
        try:
            result = self._dialogue.result(asked)
        except RemoteError as error:
            future.set_exception(error)
        else:
            if result is not None:
                future.set_result(result)

    async def close(self) -> None:
        """Give the lease back and disconnect; idempotent."""
        if self._lost is None and self._writer is not None:
            with suppress(ConnectionLostError, RemoteError):
                await self.request("release")
        await self._disconnect()

    async def _disconnect(self) -> None:
        self._lost = self._lost or ConnectionLostError("this client was closed")
        if self._listener is not None:
            self._listener.cancel()
            await asyncio.gather(self._listener, return_exceptions=True)
        if self._writer is not None:
            self._writer.close()
            with suppress(OSError):
                await self._writer.wait_closed()

    async def __aenter__(self) -> Self:
        """Connect."""
        try:
            return await self.connect()
        except BaseException:
            await self._disconnect()
            raise

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """After an error the robots hold: the connection ends without giving the right back."""
        if kind is None:
            await self.close()
        else:
            await self._disconnect()


async def _each(
    rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
) -> AsyncIterator[Sequence[float]]:
    """Rows of either kind of iterable."""
    if isinstance(rows, AsyncIterable):
        async for row in rows:
            yield row
    else:
        for row in rows:
            yield row
