"""Set-points of a user's controller at a fixed rate, under the lease: `Procedures.servo`.

Each period the controller gets the newest telemetry and returns the next set-point, which goes out as a row
of a live stream. Periods are absolute: a late controller skips periods, it never catches up in a burst.
"""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from contid.remote.client.orders import Orders
from contid.remote.protocol.wire import Code, ConnectionLostError, Fields, RemoteError

#: Rates of telemetry that a daemon grants.
MAX_TELEMETRY_HZ: Final = 200.0
FIRST_FRAME_TIMEOUT_S: Final = 2.0
#: Waiting for a notice has this resolution; the rest of a period is slept.
RESOLUTION_S: Final = 0.001
#: Messages about refused rows that a report keeps.
MAX_REFUSED: Final = 20


@dataclass(frozen=True, slots=True)
class ServoState:
    """Input of a controller in one period.

    Attributes:
        step: number of this period, from 0.
        time_s: time since the first period [s].
        robots: newest telemetry by robot: ``state``, ``fault``, ``tip_mm``, ``command``, ``measured``.
        tick: tick of that telemetry.
        refused: why the last set-point was refused (its robots hold), "" otherwise.
        reached: columns of the last set-point whose values the daemon replaced by those of the nearest
            point in reach, with their values there; empty otherwise.
    """

    step: int
    time_s: float
    robots: Mapping[str, Any]
    tick: int
    refused: str
    reached: Mapping[str, float] = field(default_factory=dict)


SetPoint: TypeAlias = Mapping[str, float] | None
#: Returns columns of a trajectory with their values, or None to end.
Controller: TypeAlias = Callable[[ServoState], SetPoint | Awaitable[SetPoint]]


@dataclass(frozen=True, slots=True)
class ServoReport:
    """Statistics of a servo loop.

    Attributes:
        steps: set-points sent.
        skipped: periods without a set-point, because the controller or the daemon was late.
        refused: set-points that were refused.
        messages: about the first of them.
        round_trip_ms: mean time from sending a set-point to its acceptance; over a network, where
            some set-points are under way at a time, to the sending of the next one.
        max_round_trip_ms: the longest.
    """

    steps: int
    skipped: int
    refused: int
    messages: tuple[str, ...]
    round_trip_ms: float
    max_round_trip_ms: float


async def servo(client: Orders, rate_hz: float, controller: Controller, nearest: bool = False) -> ServoReport:
    """Follow the set-points of a controller, called at a fixed rate with the newest telemetry."""
    tick_hz = float((await client.describe())["rate_hz"])
    if not 0.0 < rate_hz <= tick_hz:
        message = f"rate_hz={rate_hz:g}: allowed: above 0, up to the rate of the daemon, {tick_hz:g} Hz"
        raise RemoteError(Code.BAD_REQUEST, message)
    client._protocol.frames.clear()  # those of an earlier subscription are old
    await client.request("subscribe", rate_hz=min(rate_hz, MAX_TELEMETRY_HZ))
    loop = _ServoLoop(client, rate_hz, controller, nearest)
    try:
        return await loop.run()
    except BaseException:
        with suppress(ConnectionLostError, RemoteError):
            await loop.abandon()
        raise
    finally:
        with suppress(ConnectionLostError, RemoteError):
            await client.request("unsubscribe")
            client._protocol.frames.clear()


class _ServoLoop:
    """One run of a controller."""

    def __init__(self, client: Orders, rate_hz: float, controller: Controller, nearest: bool) -> None:
        self._nearest = {"nearest": True} if nearest else {}
        self._reached: Mapping[str, float] = {}
        self._client = client
        self._protocol = client._protocol
        self._period_s = 1.0 / rate_hz
        self._controller = controller
        self._columns: tuple[str, ...] = ()
        self._move = 0
        self._frame: Fields = {}
        self._messages: list[str] = []
        self._refused = self._steps = self._skipped = 0
        self._total_s = self._longest_s = 0.0

    async def run(self) -> ServoReport:
        """Until the controller returns None; then the robots settle on the last set-point."""
        await self._first_frame()
        begin_s, period, refused = time.monotonic(), 0, ""
        while True:
            now_s = time.monotonic() - begin_s
            state = ServoState(
                period, now_s, self._frame["robots"], self._frame["tick"], refused, self._reached
            )
            answer = self._controller(state)
            row = await answer if inspect.isawaitable(answer) else answer
            if row is None:
                break
            refused = await self._send(row)
            late = math.floor((time.monotonic() - begin_s) / self._period_s) - period
            self._skipped += max(late, 0)
            period += 1 + max(late, 0)
            await self._wait_until(begin_s + period * self._period_s)
        if self._move:
            # Over a network the refusals of the last rows come with the response to the end.
            self._note_refused((await self._client.request("end", move=self._move)).get("refused", ()))
            move, self._move = self._move, 0
            await self._client.wait(move)
        mean_s = self._total_s / max(self._steps, 1)
        return ServoReport(
            self._steps,
            self._skipped,
            self._refused,
            tuple(self._messages),
            mean_s * 1e3,
            self._longest_s * 1e3,
        )

    async def abandon(self) -> None:
        """After an error of the controller: the robots of the stream hold."""
        if self._move:
            robots = {name.partition(".")[0] for name in self._columns} & {*self._frame["robots"]}
            await self._client.hold(sorted(robots) or None)

    async def _first_frame(self) -> None:
        deadline_s = time.monotonic() + FIRST_FRAME_TIMEOUT_S
        self._take_frames()
        while not self._frame:
            if time.monotonic() > deadline_s:
                raise RemoteError(Code.NO_ANSWER, f"no telemetry within {FIRST_FRAME_TIMEOUT_S:g} s")
            await self._client._wait_notice(0.1)
            self._take_frames()

    def _take_frames(self) -> None:
        for frame in self._protocol.new_frames():
            if frame["event"] == "telemetry":
                self._frame = frame

    async def _send(self, row: Mapping[str, float]) -> str:
        """Send a set-point; returns why it was refused, or ""."""
        self._reached = {}
        if not self._move:
            self._columns = tuple(row)
            begun = await self._client.request("move", columns=list(self._columns), **self._nearest)
            self._move = int(begun["move"])
            if begun["timed"]:
                raise RemoteError(Code.BAD_TARGET, "a set-point has no time t_s; it counts at once")
        if row.keys() != {*self._columns}:
            expected, given = ", ".join(self._columns), ", ".join(row)
            raise RemoteError(Code.BAD_TARGET, f"the controller returned {given}; at first it was {expected}")
        values = [float(row[name]) for name in self._columns]  # also NumPy's numbers
        for name, value in zip(self._columns, values, strict=True):
            if not math.isfinite(value):
                raise RemoteError(Code.BAD_TARGET, f"the controller returned {name}={value}: no number")
        if not self._protocol.credits.get(self._move, 0):
            await self._client._wait_notice(self._period_s)
            self._check_stopped()
            if not self._protocol.credits.get(self._move, 0):
                self._skipped += 1
                return ""
        begin_s = time.monotonic()
        try:
            fields = {"move": self._move, "rows": [values]}
            request = self._protocol.request("rows", fields, newest=True)
            answer = await self._client._carry_out(request)
            refused, self._reached = answer["refused"], answer.get("reached", {})
        except RemoteError as error:
            self._check_stopped()
            if error.code == Code.SUPERSEDED:  # lost on a network; the next one follows
                self._skipped += 1
                return ""
            if error.code not in (Code.BAD_REQUEST, Code.BAD_TARGET):
                self._move = 0  # not ours any more: a hold would stop what another client does
            raise
        took_s = time.monotonic() - begin_s
        self._steps, self._total_s = self._steps + 1, self._total_s + took_s
        self._longest_s = max(self._longest_s, took_s)
        self._note_refused(refused)
        return "; ".join(refused)

    def _note_refused(self, refused: Sequence[str]) -> None:
        self._refused += bool(refused)
        self._messages += refused[: MAX_REFUSED - len(self._messages)]

    def _check_stopped(self) -> None:
        """Raise the reason when the stream was ended by a stop, a fault or another client."""
        try:
            ended = self._protocol.arrived(self._move)
        except RemoteError:
            self._move = 0  # a hold would interrupt the stop
            raise
        if ended:
            self._move = 0
            raise RemoteError(Code.STOPPED, "the stream was ended")

    async def _wait_until(self, deadline_s: float) -> None:
        """Take in telemetry until the next period."""
        while (left_s := deadline_s - time.monotonic()) > RESOLUTION_S:
            await self._client._wait_notice(left_s - 0.5 * RESOLUTION_S)
            self._take_frames()
            self._check_stopped()
        if left_s > 0.0:
            await self._client._sleep(left_s)
        self._take_frames()
