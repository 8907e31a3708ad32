"""Requests and procedures of a client, as coroutines over five abstract I/O operations.

`contid.remote.client.async_client.AsyncClient` implements these operations with asyncio.
`contid.remote.client.sync_client.Client` implements them with blocking calls: its coroutines never suspend.
"""

from __future__ import annotations

import os
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, AsyncIterable, AsyncIterator, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

from contid.remote.client.client_protocol import RESPONSE_TIMEOUT_S, ClientProtocol, Request
from contid.remote.client.servo import Controller, ServoReport, servo
from contid.remote.client.wires import Address, address_of
from contid.remote.protocol.socket_path import find
from contid.remote.protocol.wire import (
    PROTOCOL,
    Code,
    ConnectionLostError,
    Fields,
    NoDaemonError,
    RemoteError,
)

#: One robot by name, several, or None for all.
Robots: TypeAlias = str | tuple[str, ...] | list[str] | None

#: Period of pings while a client only waits; the lease lapses after two seconds.
PING_PERIOD_S: Final = 0.5
#: Period of the check whether robots are armed.
POLL_S: Final = 0.02
#: Rows of a timed trajectory in one request.
BATCH_ROWS: Final = 256

_NOT_ARMED_YET: Final = {"CONNECTING", "READY", "ARMING"}


class Procedures(ABC):
    """A connection to a daemon.

    Args:
        path: of the socket, or an address (``fleet:FLEET/NODE``); None for the only running daemon.
        name: of this client in the daemon's messages.
        timeout_s: how long to wait for a response.

    Attributes:
        path: of the socket, or the address, once connected.
        hello: the daemon's greeting: protocol, version, name, number of this client.
    """

    path: Path
    hello: Fields

    def __init__(
        self,
        path: str | Path | Address | None = None,
        *,
        name: str | None = None,
        timeout_s: float = RESPONSE_TIMEOUT_S,
    ) -> None:
        self._address = address_of(path)
        self._given = None if path is None else str(path)
        self.name = name or f"{Path(sys.argv[0]).name or 'python'}[{os.getpid()}]"
        self._protocol = ClientProtocol(timeout_s)

    # -- I/O ---------------------------------------------------------------------------------------------

    @abstractmethod
    async def _open(self, path: Path) -> None:
        """Connect; an OSError when nothing listens."""

    @abstractmethod
    async def _exchange(self, request: Request) -> Fields:
        """Send a request and wait for its result."""

    @abstractmethod
    async def _wait_notice(self, seconds: float) -> None:
        """Wait for a notice, at most so long."""

    @abstractmethod
    async def _sleep(self, seconds: float) -> None:
        """Wait for this time [s]."""

    @abstractmethod
    async def _disconnect(self) -> None:
        """Close the connection; idempotent."""

    # -- connection --------------------------------------------------------------------------------------

    async def connect(self) -> Self:
        """Connect; ``with`` and ``async with`` do it.

        Raises:
            NoDaemonError: no daemon there, or several and no path.
        """
        self.path = Path(self._address.name) if self._address is not None else find(self._given)
        try:
            await self._open(self.path)
            self.hello = await self.request("hello", protocol=PROTOCOL, name=self.name)
        except OSError as error:
            await self._disconnect()
            if isinstance(error, BlockingIOError):
                message = f"{self.path}: the daemon has not accepted the connection in time; it is overloaded"
                raise NoDaemonError(message) from error
            reason = error.strerror or error
            raise NoDaemonError(f"{self.path}: no daemon listens there ({reason})") from error
        except BaseException:
            await self._disconnect()
            raise
        return self

    async def close(self) -> None:
        """Release the lease and disconnect; idempotent."""
        with suppress(ConnectionLostError, RemoteError):
            await self.request("release")
        await self._disconnect()

    async def request(self, verb: str, /, **fields: Any) -> Fields:
        """Send any request and wait for its result; docs/remote.md lists the verbs.

        Raises:
            RemoteError: the daemon refused.
            ConnectionLostError: the connection ended.
        """
        request = self._protocol.request(verb, fields)
        try:
            return await self._exchange(request)
        finally:
            self._protocol.forget(request)

    # -- orders ------------------------------------------------------------------------------------------

    async def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and the lease."""
        return await self.request("status")

    async def describe(self) -> Fields:
        """Robots, axes, limits, and the columns of each."""
        return await self.request("describe")

    async def ping(self) -> None:
        """Keep the lease."""
        await self.request("ping")

    async def hold(self, robots: Robots = None) -> Fields:
        """Stop with limited jerk and stay; needs no lease."""
        return await self.request("hold", robots=_names(robots))

    async def stop(self, robots: Robots = None, *, end: bool = False) -> Fields:
        """Stop by the robot file's ``stop.on_interrupt``; ``end`` also ends the daemon. Needs no lease."""
        return await self.request("stop", robots=_names(robots), end=end)

    async def estop(self, robots: Robots = None) -> Fields:
        """Relax or vent now; needs no lease."""
        return await self.request("estop", robots=_names(robots))

    async def clear_fault(self, robots: Robots = None) -> Fields:
        """Re-check all devices and leave FAULT; never moves. `resume` arms."""
        return await self.request("clear_fault", robots=_names(robots))

    async def grip(self, share: float, robots: Robots = None) -> Fields:
        """Limit the effort to a share (0 to 1) of that of the robot file; moves and arms nothing."""
        return await self.request("grip", share=share, robots=_names(robots))

    async def recover(self, robots: Robots = None, *, after_stop: bool = False) -> Fields:
        """Move robots that were found outside their limits inside, slowly; they hold there."""
        return await self.request("recover", robots=_names(robots), after_stop=after_stop or None)

    async def resume(self, robots: Robots = None, *, wait: bool = True, after_stop: bool = False) -> Fields:
        """Arm if need be and follow the previous target again; waits until the robots are armed.

        Args:
            robots: names; None for all.
            wait: return when they are armed.
            after_stop: go on although another client stopped them; for a person who has checked the robots.
        """
        result = await self.request("resume", robots=_names(robots), after_stop=after_stop or None)
        while wait and _NOT_ARMED_YET & set(result["robots"].values()):
            await self._sleep(POLL_S)
            status = await self.status()
            result["robots"] = {name: status["robots"][name]["state"] for name in result["robots"]}
        return result

    async def acquire(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Acquire the lease; without a request for ``timeout_s`` it lapses and the robots hold."""
        return await self.request("acquire", timeout_s=timeout_s, takeover=takeover)

    async def release(self) -> bool:
        """Release the lease; a point in progress is still reached. True when this client held it."""
        return bool((await self.request("release"))["released"])

    # -- moving ------------------------------------------------------------------------------------------

    async def move(self, target: Mapping[str, float], *, wait: bool = True) -> int:
        """Go to a point, jerk-limited, and hold there; returns the number of the move.

        Args:
            target: columns as in a trajectory: ``{"x_mm": 40, "y_mm": 75}``, ``{"left.x_mm": ...}``.
            wait: return on arrival; otherwise call `wait` with the returned number, or `release`.

        Raises:
            RemoteError: refused, or stopped on the way.
        """
        number = int((await self.request("move", target=dict(target)))["move"])
        if wait:
            await self.wait(number)
        return number

    async def stream(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
        *,
        wait: bool = True,
    ) -> list[str]:
        """Follow rows; with a column ``t_s`` they are collected, checked and then played in time.

        Sends only as many rows as the daemon grants. Without ``t_s`` every row is the target at once, and
        ``rows`` may be a slow generator.

        Returns:
            Messages about refused rows; their robots held until the next good row.
        """
        move, refused = await self._send_all(columns, rows)
        await self.request("end", move=move)
        if wait:
            await self.wait(move)
        return refused

    async def load(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
    ) -> int:
        """Send a timed trajectory and have it checked; nothing moves before `start`.

        Returns:
            The number of the move.
        """
        move, _ = await self._send_all(columns, rows)
        await self.request("end", move=move, hold_at_start=True)
        return move

    async def start(self, move: int, at_s: float | None = None) -> Fields:
        """Go to the first row of a loaded trajectory and wait there; with a time, begin then.

        Args:
            move: the number that `load` returned.
            at_s: time of the first row, by `time.monotonic` on the machine of the daemon, 0.2 to 60 s ahead.
        """
        return await self.request("start", move=move, at_s=at_s)

    async def started(self, move: int) -> Fields:
        """Wait until a trajectory that was started begins.

        Returns:
            ``tick``; ``at_s``, the time ordered; ``began_s``, when that tick started on the daemon's machine.

        Raises:
            RemoteError: it was stopped before.
        """
        while move not in self._protocol.started:
            await self._listen()
            self._protocol.check_open(move)
        return self._protocol.started[move]

    async def _send_all(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
    ) -> tuple[int, list[str]]:
        """Begin a stream and send its rows; returns its number, and messages about refused rows."""
        begun = await self.request("move", columns=list(columns))
        move = int(begun["move"])
        batch_rows = min(int(begun["credits"]), BATCH_ROWS) if begun["timed"] else 1
        batch: list[list[float]] = []
        refused: list[str] = []
        async for row in _each(rows):
            batch.append(list(row))
            if len(batch) >= batch_rows:
                refused += await self._send_rows(move, batch, bool(begun["timed"]))
                batch = []
        if batch:
            refused += await self._send_rows(move, batch, bool(begun["timed"]))
        return move, refused

    async def servo(self, rate_hz: float, controller: Controller) -> ServoReport:
        """Follow the set-points of a controller, called at a fixed rate with the newest telemetry.

        Args:
            rate_hz: up to the rate of the daemon's tick.
            controller: gets a `ServoState`; returns columns of a trajectory with their values,
                ``{"x_mm": 40.0, "y_mm": 75.0}``, always the same ones, or None to end. It has to
                return within a period; while it hangs the lease lapses and the robots hold.

        Returns:
            Counts of set-points, skipped periods and refused set-points, after the robots arrived at the
            last one.

        Raises:
            RemoteError: refused, or stopped by another client or a fault. After an error of the controller
                itself the robots hold.
        """
        return await servo(self, rate_hz, controller)

    async def _send_rows(self, move: int, rows: list[list[float]], timed: bool) -> list[str]:
        while self._protocol.credits.get(move, 0) < len(rows):
            await self._listen()
            if self._protocol.arrived(move):
                break  # the daemon refuses further rows with the reason
        try:
            refused: list[str] = (await self.request("rows", move=move, rows=rows))["refused"]
        except RemoteError as error:
            if timed or error.code != Code.SUPERSEDED:  # of live rows the newest counts
                raise
            return []
        return refused

    async def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the lease meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        while not self._protocol.arrived(move):
            await self._listen()

    # -- measuring and telemetry -------------------------------------------------------------------------

    async def measure(
        self,
        tip_mm: Sequence[float],
        *,
        direction: Sequence[float] | None = None,
        robot: str | None = None,
        age_ms: float | None = None,
        time_s: float | None = None,
    ) -> Fields:
        """Send the tip position that a tracker measured; needs no lease, one tracker per robot.

        Args:
            tip_mm: position in the world frame, ``(x, y, z)``.
            direction: of the body at its tip, in the world frame; its length does not matter.
            robot: its name; may be left out when there is only one.
            age_ms: time since the capture; 0 when neither time is given.
            time_s: time of the capture, by `time.monotonic` on this machine; instead of ``age_ms``.

        Returns:
            ``used``: False when a newer one was there already; ``feedback``: True when it corrects targets.

        Raises:
            RemoteError: not a finite number, too old, out of reach, or another client tracks the robot.
        """
        return await self.request(
            "measure",
            robot=robot,
            tip_mm=[float(value) for value in tip_mm],  # also NumPy's numbers
            direction=None if direction is None else [float(value) for value in direction],
            age_ms=None if age_ms is None else float(age_ms),
            time_s=None if time_s is None else float(time_s),
        )

    async def telemetry(
        self,
        rate_hz: float = 20.0,
        *,
        robots: Robots = None,
        fields: Sequence[str] | None = None,
        events: bool = False,
    ) -> AsyncGenerator[Fields, None]:
        """Frames as they come, without end.

        A slow reader gets the newest frames, with a count of the dropped ones. With ``events``, states,
        faults and refusals come in between. Iterating keeps the lease.
        """
        chosen = list(fields) if fields else None
        await self.request("subscribe", rate_hz=rate_hz, robots=_names(robots), fields=chosen, events=events)
        try:
            while True:
                for frame in self._protocol.new_frames():
                    yield frame
                await self._listen()
        finally:
            with suppress(ConnectionLostError, RemoteError):
                await self.request("unsubscribe")
                self._protocol.frames.clear()

    async def _listen(self) -> None:
        """Wait for a notice; a loop of these keeps the lease."""
        await self._wait_notice(PING_PERIOD_S)
        if time.monotonic() - self._protocol.requested_s > PING_PERIOD_S:
            await self.ping()


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


def _names(robots: Robots) -> list[str] | None:
    if robots is None:
        return None
    return [robots] if isinstance(robots, str) else list(robots)
