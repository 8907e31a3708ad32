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

from contid.remote.inbox import (
    ALIVE_S,
    ANSWER_S,
    PATIENCE_S,
    Notices,
    list_of,
    measurement,
    parse,
    result_of,
    without_none,
)
from contid.remote.place import find
from contid.remote.protocol import (
    MAX_LINE,
    PROTOCOL,
    ConnectionLostError,
    Fields,
    NoDaemonError,
    RemoteError,
    encode,
)
from contid.remote.sync_client import Robots


class AsyncClient:
    """A connection to a daemon; several tasks may use it. Open it with ``async with``.

    The motion right is kept only by requests and by awaiting a move or telemetry, never by a task in the
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
        self._timeout_s = timeout_s
        self._notices = Notices()
        self._number = 0
        self._waiting: dict[int, asyncio.Future[Fields]] = {}
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
            # Telemetry of many robots is longer than a request may be.
            reader, self._writer = await asyncio.open_unix_connection(self.path, limit=16 * MAX_LINE)
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
        self._number += 1
        number = self._number
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        patience_s = max(self._timeout_s, PATIENCE_S.get(verb, 0.0))
        try:
            self._writer.write(encode({"id": number, "verb": verb, **without_none(fields)}))
            with suppress(ConnectionError):
                await self._writer.drain()
            async with asyncio.timeout(patience_s):
                return result_of(await future)
        except TimeoutError:
            raise self._notices.gone(f"no answer within {patience_s:g} s") from None
        finally:
            self._waiting.pop(number, None)

    async def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and who may move."""
        return await self.request("status")

    async def describe(self) -> Fields:
        """Robots, axes, limits, and the columns each understands."""
        return await self.request("describe")

    async def ping(self) -> None:
        """Show that this client is alive; keeps the motion right."""
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
        told = await self.request("resume", robots=list_of(robots))
        while wait and set(told["robots"].values()) & {"CONNECTING", "READY", "ARMING"}:
            await asyncio.sleep(0.02)
            status = (await self.status())["robots"]
            told["robots"] = {name: status[name]["state"] for name in told["robots"]}
        return told

    async def take(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Take the motion right: without a request for ``timeout_s`` it is lost and the robots hold."""
        return await self.request("take", timeout_s=timeout_s, takeover=takeover)

    async def release(self) -> bool:
        """Give the motion right back; a point that is under way is still reached."""
        return bool((await self.request("release"))["released"])

    async def move(self, target: Mapping[str, float], *, wait: bool = True) -> int:
        """Go to a point, jerk-limited, and hold there; see `contid.client.Client.move`."""
        move = int((await self.request("move", target=dict(target)))["move"])
        if wait:
            await self.wait(move)
        return move

    async def stream(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
        *,
        wait: bool = True,
    ) -> list[str]:
        """Follow rows under the daemon's credit; see `contid.client.Client.stream`."""
        begun = await self.request("move", columns=list(columns))
        move, granted, timed = int(begun["move"]), int(begun["credits"]), bool(begun["timed"])
        refused: list[str] = []
        batch: list[Sequence[float]] = []
        async for row in _each(rows):
            batch.append(list(row))
            if timed and len(batch) < min(granted, 256):
                continue
            while granted < len(batch):
                granted = await self._credit(move, granted)
            granted = await self._send_rows(move, batch, refused)
        if batch:
            await self._send_rows(move, batch, refused)
        await self.request("end", move=move)
        if wait:
            await self.wait(move)
        return refused

    async def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the motion right meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        while not self._notices.check_arrival(move):
            await self._more()

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
        return await self.request("measure", **measurement(tip_mm, direction, robot, age_ms, time_s))

    async def telemetry(
        self,
        rate_hz: float = 20.0,
        *,
        robots: Robots = None,
        fields: Sequence[str] | None = None,
        events: bool = False,
    ) -> AsyncIterator[Fields]:
        """Frames as they come, for ever; see `contid.client.Client.telemetry`."""
        await self.request(
            "subscribe",
            rate_hz=rate_hz,
            robots=list_of(robots),
            fields=fields and list(fields),
            events=events,
        )
        try:
            while True:
                while self._notices.frames:
                    yield self._notices.frames.popleft()
                await self._more()
        finally:
            if self._lost is None:
                await self.request("unsubscribe")
                self._notices.frames.clear()

    # -- inside --------------------------------------------------------------------------------------------

    async def _send_rows(self, move: int, batch: list[Sequence[float]], refused: list[str]) -> int:
        told = await self.request("rows", move=move, rows=batch)
        refused += told["refused"]
        batch.clear()
        return int(told["credits"])

    async def _credit(self, move: int, granted: int) -> int:
        if move not in self._notices.credits:
            await self._more()
        self._notices.check_arrival(move)
        return self._notices.credits.pop(move, granted)

    async def _more(self) -> None:
        """Wait for a notice; show that this client is alive when none comes."""
        if self._lost is not None:
            raise self._lost
        self._news.clear()
        try:
            async with asyncio.timeout(ALIVE_S):
                await self._news.wait()
        except TimeoutError:
            await self.ping()

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        """Sort what comes until the connection ends."""
        words = "the daemon closed the connection"
        try:
            while line := await reader.readline():
                answer = parse(line, self._notices)
                if answer is None:
                    self._news.set()
                elif (future := self._waiting.get(answer.get("id") or 0)) and not future.done():
                    future.set_result(answer)
        except RemoteError as error:
            self._lost = error
        except (OSError, ValueError) as error:
            words = f"the connection ended ({error})"
        self._lost = self._lost or self._notices.gone(words)
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(self._lost)
        self._news.set()

    async def close(self) -> None:
        """Give the motion right back and disconnect; idempotent."""
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
