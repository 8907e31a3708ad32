"""Procedures of a client - moves, measurements, telemetry - over its requests and orders.

`contid_library.async_client.AsyncClient` implements the I/O operations of `Orders` with asyncio.
`contid.remote.client.sync_client.Client` implements them with blocking calls: its coroutines never suspend.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, AsyncIterable, Iterable, Mapping, Sequence
from contextlib import suppress

from contid.entry_points import LIBRARY, required
from contid.remote.client.orders import Orders, Robots, names_of
from contid.remote.client.servo import Controller, ServoReport
from contid.remote.protocol.wire import ConnectionLostError, Fields, RemoteError


def measured_tip(
    tip_mm: Sequence[float], direction: Sequence[float] | None, robot: str | None, time_s: float | None
) -> Fields:
    """The fields of a measured tip, also of NumPy's numbers; arguments as of `Procedures.measure`."""
    return {
        "robot": robot,
        "tip_mm": [float(value) for value in tip_mm],
        "direction": None if direction is None else [float(value) for value in direction],
        "time_s": None if time_s is None else float(time_s),
    }


class Procedures(Orders):
    """A connection to a daemon; arguments and attributes are those of `Orders`."""

    async def move(
        self, target: Mapping[str, float], *, until_force_n: float | None = None, wait: bool = True
    ) -> int:
        """Go to a point, jerk-limited, and hold there; returns the number of the move.

        Args:
            target: columns as in a trajectory: ``{"x_mm": 40, "y_mm": 75}``, ``{"left.x_mm": ...}``.
            until_force_n: for fingers, force [N]: close slowly until the tip exerts this force along its way;
                hold it.
            wait: return on arrival; otherwise call `wait` with the returned number, or `release`.

        Raises:
            RemoteError: refused, or stopped on the way.
        """
        response = await self.request("move", target=dict(target), until_force_n=until_force_n)
        number = int(response["move"])
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

        Sends as many rows as the daemon grants, without waiting for responses. Without ``t_s`` every row is
        the target at once, and ``rows`` may be a slow generator.

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
            if move not in self._protocol.started:  # else its end, if it came too, is for `wait`
                self._protocol.arrived(move)  # raises when it was stopped
        return self._protocol.started[move]

    async def _send_all(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
    ) -> tuple[int, list[str]]:
        """Begin a stream and send its rows; returns its number, and messages about refused rows."""
        begun = await self.request("move", columns=list(columns))
        move, timed = int(begun["move"]), bool(begun["timed"])
        rows_of = required(LIBRARY, "RowStream", "a stream of rows", "library")
        stream = rows_of(self, move, timed, int(begun["credits"]))
        await stream.send(rows)
        return move, stream.refused

    async def servo(self, rate_hz: float, controller: Controller, *, nearest: bool = False) -> ServoReport:
        """Follow the set-points of a controller, called at a fixed rate with the newest telemetry.

        A subscription of the same client ends, and its frames that were not taken are dropped.

        Args:
            rate_hz: up to the rate of the daemon's tick.
            controller: gets a `ServoState`; returns columns of a trajectory with their values,
                ``{"x_mm": 40.0, "y_mm": 75.0}``, always the same ones, or None to end. It has to
                return within a period; while it hangs the lease lapses and the robots hold.
            nearest: where a tip leads out of reach, and the point of the reach that is nearest to it is a
                step along the edge, it goes there, which the next state has; so do the lengths of bends.

        Returns:
            Counts of set-points, skipped periods and refused set-points, after the robots arrived at the
            last one.

        Raises:
            RemoteError: refused, or stopped by another client or a fault. After an error of the controller
                itself the robots hold.
        """
        servo = required(LIBRARY, "servo", "a servo loop", "library")
        report: ServoReport = await servo(self, rate_hz, controller, nearest)
        return report

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
            direction: direction of the body at its tip, in the world frame; its length does not matter.
            robot: its name; may be left out when there is only one.
            age_ms: time since the capture; 0 when neither time is given.
            time_s: time of the capture, by `time.monotonic` on this machine; instead of ``age_ms``.

        Returns:
            ``used``: False when a newer one was there already; ``feedback``: True when it corrects targets.

        Raises:
            RemoteError: not a finite number, too old, out of reach, or another client tracks the robot.
        """
        age = None if age_ms is None else float(age_ms)
        return await self.request("measure", age_ms=age, **measured_tip(tip_mm, direction, robot, time_s))

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
        await self.request(
            "subscribe", rate_hz=rate_hz, robots=names_of(robots), fields=chosen, events=events
        )
        try:
            while True:
                for frame in self._protocol.new_frames():
                    yield frame
                await self._listen()
        finally:
            with suppress(ConnectionLostError, RemoteError):
                await self.request("unsubscribe")
                self._protocol.frames.clear()
