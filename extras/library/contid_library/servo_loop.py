"""Set-points of a user's controller at a fixed rate, under the lease: `Procedures.servo`.

Each period the controller gets the newest telemetry and returns the next set-point, which goes out as a row
of a live stream: a move without an end, which the first set-point begins and whose columns it fixes. Periods
are absolute: a late controller skips periods, it never catches up in a burst.

How it ends:

* the controller returns None: the stream is ended, and the robots settle on the last set-point;
* the controller raises, or returns what is no set-point: the robots of the stream hold;
* a stop, a fault or another client ended the stream: the reason is raised, and nothing is sent, because a
  hold would interrupt what moves or stops the robots now.
"""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Final

from contid.remote.client.orders import Orders
from contid.remote.client.servo import Controller, ServoReport, ServoState, SetPoint
from contid.remote.protocol.wire import Code, ConnectionLostError, Fields, RemoteError

#: Rates of telemetry that a daemon grants.
MAX_TELEMETRY_HZ: Final = 200.0
FIRST_FRAME_TIMEOUT_S: Final = 2.0
#: Waiting for a notice has this resolution; the rest of a period is slept.
RESOLUTION_S: Final = 0.001
#: Messages about refused rows that a report keeps.
MAX_REFUSED: Final = 20


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
        self._client = client
        self._protocol = client._protocol
        self._period_s = 1.0 / rate_hz
        self._controller = controller
        self._nearest = {"nearest": True} if nearest else {}
        #: Number of the move that is the stream; 0 before the first set-point, and once it is no longer ours.
        self._move = 0
        self._columns: tuple[str, ...] = ()
        #: Newest telemetry.
        self._frame: Fields = {}
        #: What the last set-point led to: why it was refused, "" otherwise; columns that were replaced.
        self._refused = ""
        self._reached: Mapping[str, float] = {}
        #: For the report.
        self._messages: list[str] = []
        self._refusals = self._steps = self._skipped = 0
        self._total_s = self._longest_s = 0.0

    async def run(self) -> ServoReport:
        """Until the controller returns None; then the robots settle on the last set-point."""
        await self._await_first_frame()
        begin_s, period = time.monotonic(), 0
        while (row := await self._ask_controller(period, time.monotonic() - begin_s)) is not None:
            await self._send(row)
            periods_late = math.floor((time.monotonic() - begin_s) / self._period_s) - period
            self._skipped += max(periods_late, 0)
            period += 1 + max(periods_late, 0)
            await self._wait_until(begin_s + period * self._period_s)
        if self._move:
            # Over a network the refusals of the last rows come with the response to the end.
            self._note_refused((await self._client.request("end", move=self._move)).get("refused", ()))
            move, self._move = self._move, 0
            await self._client.wait(move)
        mean_s = self._total_s / max(self._steps, 1)
        return ServoReport(
            steps=self._steps,
            skipped=self._skipped,
            refused=self._refusals,
            messages=tuple(self._messages),
            round_trip_ms=mean_s * 1e3,
            max_round_trip_ms=self._longest_s * 1e3,
        )

    async def abandon(self) -> None:
        """After an error: the robots of the stream hold, if it is still ours."""
        if self._move:
            robots = {name.partition(".")[0] for name in self._columns} & {*self._frame["robots"]}
            await self._client.hold(sorted(robots) or None)

    async def _await_first_frame(self) -> None:
        """Wait for telemetry.

        Raises:
            RemoteError: there is none within `FIRST_FRAME_TIMEOUT_S`.
        """
        deadline_s = time.monotonic() + FIRST_FRAME_TIMEOUT_S
        self._take_frames()
        while not self._frame:
            if time.monotonic() > deadline_s:
                raise RemoteError(Code.NO_ANSWER, f"no telemetry within {FIRST_FRAME_TIMEOUT_S:g} s")
            await self._client._wait_notice(0.1)
            self._take_frames()

    def _take_frames(self) -> None:
        """Keep the newest telemetry that has arrived."""
        for frame in self._protocol.new_frames():
            if frame["event"] == "telemetry":
                self._frame = frame

    async def _ask_controller(self, period: int, now_s: float) -> SetPoint:
        """The set-point of a period, ``now_s`` after the first; None to end."""
        robots, tick = self._frame["robots"], self._frame["tick"]
        answer = self._controller(ServoState(period, now_s, robots, tick, self._refused, self._reached))
        return await answer if inspect.isawaitable(answer) else answer

    async def _send(self, row: Mapping[str, float]) -> None:
        """Send a set-point; one for which the daemon or the network has no place is skipped.

        Raises:
            RemoteError: it is no set-point of the stream, or the stream was ended.
        """
        self._refused, self._reached = "", {}
        if not self._move:
            await self._begin_stream(row)
        values = self._values(row)
        if not await self._may_send():
            self._skipped += 1
            return
        begin_s = time.monotonic()
        answer = await self._send_values(values)
        if answer is None:
            self._skipped += 1
            return
        took_s = time.monotonic() - begin_s
        self._steps, self._total_s = self._steps + 1, self._total_s + took_s
        self._longest_s = max(self._longest_s, took_s)
        self._note_refused(answer["refused"])
        self._refused, self._reached = "; ".join(answer["refused"]), answer.get("reached", {})

    async def _begin_stream(self, row: Mapping[str, float]) -> None:
        """Begin the move, with the columns of the first set-point."""
        self._columns = tuple(row)
        begun = await self._client.request("move", columns=list(self._columns), **self._nearest)
        self._move = int(begun["move"])
        if begun["timed"]:
            raise RemoteError(Code.BAD_TARGET, "a set-point has no time t_s; it counts at once")

    def _values(self, row: Mapping[str, float]) -> list[float]:
        """The numbers of a set-point in the order of the columns.

        Raises:
            RemoteError: it has other columns than the first, or a value that is not finite.
        """
        if row.keys() != {*self._columns}:
            expected, given = ", ".join(self._columns), ", ".join(row)
            raise RemoteError(Code.BAD_TARGET, f"the controller returned {given}; at first it was {expected}")
        values = [float(row[name]) for name in self._columns]  # also NumPy's numbers
        for name, value in zip(self._columns, values, strict=True):
            if not math.isfinite(value):
                raise RemoteError(Code.BAD_TARGET, f"the controller returned {name}={value}: no number")
        return values

    async def _may_send(self) -> bool:
        """Whether the daemon takes a row; if not now, its permission is waited for, a period at most."""
        if self._protocol.credits.get(self._move, 0):
            return True
        await self._client._wait_notice(self._period_s)
        self._require_stream()
        return bool(self._protocol.credits.get(self._move, 0))

    async def _send_values(self, values: list[float]) -> Fields | None:
        """The response to a row; None for one that a network lost: the next one follows."""
        fields = {"move": self._move, "rows": [values]}
        try:
            request = self._protocol.request("rows", fields, newest=True)
            return await self._client._carry_out(request)
        except RemoteError as error:
            self._require_stream()
            if error.code == Code.SUPERSEDED:
                return None
            if error.code not in (Code.BAD_REQUEST, Code.BAD_TARGET):
                self._move = 0  # not ours any more: a hold would stop what another client does
            raise

    def _note_refused(self, refused: Sequence[str]) -> None:
        self._refusals += bool(refused)
        self._messages += refused[: MAX_REFUSED - len(self._messages)]

    def _require_stream(self) -> None:
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
            self._require_stream()
        if left_s > 0.0:
            await self._client._sleep(left_s)
        self._take_frames()
