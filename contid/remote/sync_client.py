"""The client for scripts and notebooks; see `contid.client`."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from contid.remote.protocol import PROTOCOL, ConnectionLostError, Fields, NoDaemonError, encode

#: Which robots: one by name, several, or None for all.
Robots = str | tuple[str, ...] | list[str] | None


class Client:
    """A connection to a daemon. Not for several threads at once: give each its own.

    Args:
        path: of the socket; None for the only daemon that runs.
        name: what the daemon calls this client in its messages.
        timeout_s: how long to wait for an answer.

    Raises:
        NoDaemonError: no daemon there, or several and no path.
    """

    def __init__(
        self, path: str | Path | None = None, *, name: str | None = None, timeout_s: float = ANSWER_S
    ) -> None:
        self.path = find(None if path is None else str(path))
        self.name = name or f"{Path(sys.argv[0]).name or 'python'}[{os.getpid()}]"
        self._timeout_s = timeout_s
        self._notices = Notices()
        self._buffer = bytearray()
        self._number = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.settimeout(timeout_s)
            self._socket.connect(str(self.path))
            self.hello = self.request("hello", protocol=PROTOCOL, name=self.name)
        except OSError as error:
            self._socket.close()
            raise NoDaemonError(
                f"{self.path}: no daemon listens there ({error.strerror or error})"
            ) from error
        except BaseException:
            self._socket.close()
            raise

    # -- requests ------------------------------------------------------------------------------------------

    def request(self, verb: str, **fields: Any) -> Fields:
        """Send any request and wait for its result; see docs/remote.md for the verbs.

        Raises:
            RemoteError: the daemon refused.
            ConnectionLostError: it is gone.
        """
        self._number += 1
        number = self._number
        try:
            self._socket.settimeout(self._timeout_s)
            self._socket.sendall(encode({"id": number, "verb": verb, **without_none(fields)}))
        except OSError as error:
            self._drain()
            raise self._notices.gone(f"the connection ended ({error.strerror or error})") from None
        patience_s = max(self._timeout_s, PATIENCE_S.get(verb, 0.0))
        deadline_s = time.monotonic() + patience_s
        while True:
            answer = self._next(deadline_s - time.monotonic())
            if answer is None and time.monotonic() >= deadline_s:
                raise self._notices.gone(f"no answer within {patience_s:g} s")
            if answer is not None and answer.get("id") in (number, None):
                return result_of(answer)

    def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and who may move."""
        return self.request("status")

    def describe(self) -> Fields:
        """Robots, axes, limits, and the columns each understands."""
        return self.request("describe")

    def ping(self) -> None:
        """Show that this client is alive; keeps the motion right."""
        self.request("ping")

    def hold(self, robots: Robots = None) -> Fields:
        """Stop with limited jerk and stay; everybody may."""
        return self.request("hold", robots=list_of(robots))

    def stop(self, robots: Robots = None, *, end: bool = False) -> Fields:
        """Stop by the robot file's ``stop.on_interrupt``; ``end`` ends the daemon too. Everybody may."""
        return self.request("stop", robots=list_of(robots), end=end)

    def estop(self, robots: Robots = None) -> Fields:
        """Relax or vent now; everybody may."""
        return self.request("estop", robots=list_of(robots))

    def clear_fault(self, robots: Robots = None) -> Fields:
        """Look at everything again and leave FAULT; never moves. `resume` arms."""
        return self.request("clear_fault", robots=list_of(robots))

    def resume(self, robots: Robots = None, *, wait: bool = True) -> Fields:
        """Arm if need be and go on with what was followed; waits until the robots are armed."""
        told = self.request("resume", robots=list_of(robots))
        while wait and set(told["robots"].values()) & {"CONNECTING", "READY", "ARMING"}:
            time.sleep(0.02)
            status = self.status()["robots"]
            told["robots"] = {name: status[name]["state"] for name in told["robots"]}
        return told

    def take(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Take the motion right: without a request for ``timeout_s`` it is lost and the robots hold."""
        self._notices.lost_right = ""
        return self.request("take", timeout_s=timeout_s, takeover=takeover)

    def release(self) -> bool:
        """Give the motion right back; a point that is under way is still reached."""
        return bool(self.request("release")["released"])

    # -- moving --------------------------------------------------------------------------------------------

    def move(self, target: Mapping[str, float], *, wait: bool = True) -> int:
        """Go to a point, jerk-limited, and hold there.

        Args:
            target: columns as in a trajectory: ``{"x_mm": 40, "y_mm": 75}``, ``{"left.x_mm": ...}``.
            wait: return on arrival; otherwise call `wait` with the number that is returned, or release.

        Raises:
            RemoteError: refused, or stopped on the way.
        """
        move = int(self.request("move", target=dict(target))["move"])
        if wait:
            self.wait(move)
        return move

    def stream(
        self, columns: Sequence[str], rows: Iterable[Sequence[float]], *, wait: bool = True
    ) -> list[str]:
        """Follow rows; with a column ``t_s`` they are collected, checked and then played in time.

        Sends only as many rows as the daemon grants. Without ``t_s`` every row is the target at once, and
        ``rows`` may be a generator that takes its time.

        Returns:
            Rows that were refused, in words; their robots held until the next good row.
        """
        begun = self.request("move", columns=list(columns))
        move, granted, timed = int(begun["move"]), int(begun["credits"]), bool(begun["timed"])
        refused: list[str] = []
        batch: list[Sequence[float]] = []
        for row in rows:
            batch.append(list(row))
            if timed and len(batch) < min(granted, 256):
                continue
            while granted < len(batch):
                granted = self._credit(move, granted)
            granted = self._send_rows(move, batch, refused)
        if batch:
            self._send_rows(move, batch, refused)
        self.request("end", move=move)
        if wait:
            self.wait(move)
        return refused

    def _send_rows(self, move: int, batch: list[Sequence[float]], refused: list[str]) -> int:
        told = self.request("rows", move=move, rows=batch)
        refused += told["refused"]
        batch.clear()
        return int(told["credits"])

    def _credit(self, move: int, granted: int) -> int:
        """Wait for credit."""
        if move not in self._notices.credits and self._next(ALIVE_S) is None:
            self.ping()
        self._notices.check_arrival(move)
        return self._notices.credits.pop(move, granted)

    def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the motion right meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        alive_s = time.monotonic()
        while not self._notices.check_arrival(move):
            self._next(ALIVE_S)
            if time.monotonic() - alive_s > ALIVE_S:
                alive_s = time.monotonic()
                self.ping()

    # -- measuring -----------------------------------------------------------------------------------------

    def measure(
        self,
        tip_mm: Sequence[float],
        *,
        direction: Sequence[float] | None = None,
        robot: str | None = None,
        age_ms: float | None = None,
        time_s: float | None = None,
    ) -> Fields:
        """Say where a tracker sees the tip of a robot; needs no motion right, one tracker per robot.

        Args:
            tip_mm: position in the world frame.
            direction: of the body at its tip, in the world frame; its length does not matter.
            robot: whose; may be left out when there is only one.
            age_ms: how long ago it was captured.
            time_s: when it was captured, by `time.monotonic` on this machine; instead of ``age_ms``.

        Returns:
            ``used``: False when a newer one was there already; ``feedback``: True when it corrects targets.

        Raises:
            RemoteError: not a finite number, too old, not within reach, or somebody else tracks the robot.
        """
        return self.request("measure", **measurement(tip_mm, direction, robot, age_ms, time_s))

    # -- listening -----------------------------------------------------------------------------------------

    def telemetry(
        self,
        rate_hz: float = 20.0,
        *,
        robots: Robots = None,
        fields: Sequence[str] | None = None,
        events: bool = False,
    ) -> Iterator[Fields]:
        """Frames as they come, for ever; ``break`` when it is enough.

        Whoever is too slow gets the newest frames, with a count of the dropped ones. With ``events``, states,
        faults and refusals come in between. Iterating keeps the motion right; not iterating loses it.
        """
        self.request(
            "subscribe",
            rate_hz=rate_hz,
            robots=list_of(robots),
            fields=fields and list(fields),
            events=events,
        )
        alive_s = time.monotonic()
        try:
            while True:
                while self._notices.frames:
                    yield self._notices.frames.popleft()
                self._next(ALIVE_S)
                if time.monotonic() - alive_s > ALIVE_S:
                    alive_s = time.monotonic()
                    self.ping()
        finally:
            self._unsubscribe()

    def _unsubscribe(self) -> None:
        try:
            self.request("unsubscribe")
        except ConnectionLostError:
            return
        self._notices.frames.clear()

    # -- inside --------------------------------------------------------------------------------------------

    def _next(self, timeout_s: float) -> Fields | None:
        """The next answer, or None after a notice or the time."""
        while b"\n" not in self._buffer:
            try:
                self._socket.settimeout(max(timeout_s, 0.001))
                chunk = self._socket.recv(1 << 16)
            except TimeoutError:
                return None
            except OSError as error:
                raise self._notices.gone(f"the connection ended ({error.strerror or error})") from None
            if not chunk:
                raise self._notices.gone("the daemon closed the connection")
            self._buffer += chunk
        line, _, rest = bytes(self._buffer).partition(b"\n")
        self._buffer[:] = rest
        return parse(line, self._notices)

    def _drain(self) -> None:
        """The daemon's last words, if there are any."""
        try:
            while not self._notices.farewell:
                self._next(0.1)
        except ConnectionLostError:
            return

    def close(self) -> None:
        """Give the motion right back and disconnect; idempotent."""
        if self._socket.fileno() < 0:
            return
        try:
            self.request("release")
        except (ConnectionLostError, OSError):
            pass
        finally:
            self._socket.close()

    def __enter__(self) -> Self:
        """Close on leaving."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """After an error the robots hold: the connection ends without giving the right back."""
        if kind is None:
            self.close()
        else:
            self._socket.close()
