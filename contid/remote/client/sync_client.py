"""The client for scripts and notebooks; see `contid.client`."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from contid.remote.client import procedures as steps
from contid.remote.client.client_protocol import ANSWER_S, CHUNK, ClientProtocol
from contid.remote.client.procedures import Ask, Listen, Pause, Robots, RowSender, Steps, T, list_of
from contid.remote.protocol.socket_path import find
from contid.remote.protocol.wire import PROTOCOL, ConnectionLostError, Fields, NoDaemonError

#: How long the last words of a daemon that takes no request any more are waited for.
LAST_WORDS_S: Final = 0.5


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
        self._dialogue = ClientProtocol(timeout_s)
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
        asked = self._dialogue.ask(verb, fields)
        try:
            self._socket.settimeout(asked.patience_s)
            self._socket.sendall(asked.line)
        except OSError as error:
            self._drain()
            raise self._dialogue.gone(f"the connection ended ({error.strerror or error})") from None
        deadline_s = time.monotonic() + asked.patience_s
        try:
            while (result := self._dialogue.result(asked)) is None:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    raise self._dialogue.gone(f"no answer within {asked.patience_s:g} s")
                self._read(left_s)
        finally:
            self._dialogue.forget(asked)
        return result

    def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and who may move."""
        return self.request("status")

    def describe(self) -> Fields:
        """Robots, axes, limits, and the columns each understands."""
        return self.request("describe")

    def ping(self) -> None:
        """Show that this client is alive; keeps the lease."""
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
        return self._follow(steps.resume(robots, wait))

    def acquire(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Acquire the lease; without a request for ``timeout_s`` it lapses and the robots hold."""
        return self.request("acquire", timeout_s=timeout_s, takeover=takeover)

    def release(self) -> bool:
        """Release the lease; a point that is under way is still reached."""
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
        return self._follow(steps.move(self._dialogue, target, wait))

    def stream(
        self, columns: Sequence[str], rows: Iterable[Sequence[float]], *, wait: bool = True
    ) -> list[str]:
        """Follow rows; with a column ``t_s`` they are collected, checked and then played in time.

        Sends only as many rows as the daemon grants. Without ``t_s`` every row is the target at once, and
        ``rows`` may be a generator that takes its time.

        Returns:
            Rows that were refused, in words; their robots held until the next good row.
        """
        sender = RowSender(self._dialogue, columns)
        self._follow(sender.begin())
        for row in rows:
            self._follow(sender.add(row))
        self._follow(sender.end(wait))
        return sender.refused

    def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the lease meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        self._follow(steps.arrival(self._dialogue, move))

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
        """Say where a tracker sees the tip of a robot; needs no lease, one tracker per robot.

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
        return self.request("measure", **steps.measurement(tip_mm, direction, robot, age_ms, time_s))

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
        faults and refusals come in between. Iterating keeps the lease; not iterating loses it.
        """
        self.request("subscribe", **steps.subscription(rate_hz, robots, fields, events))
        try:
            while True:
                yield from self._dialogue.new_frames()
                self._follow(steps.listen(self._dialogue))
        finally:
            with suppress(ConnectionLostError):
                self.request("unsubscribe")
                self._dialogue.frames.clear()

    # -- inside --------------------------------------------------------------------------------------------

    def _follow(self, procedure: Steps[T]) -> T:
        """Carry out a procedure."""
        result: Fields = {}
        try:
            step = next(procedure)
            while True:
                match step:
                    case Ask(verb, fields):
                        result = self.request(verb, **fields)
                    case Pause(seconds):
                        time.sleep(seconds)
                    case Listen(seconds):
                        self._listen(seconds)
                step = procedure.send(result)
        except StopIteration as stop:
            told: T = stop.value
            return told

    def _listen(self, seconds: float) -> None:
        """Wait until a notice comes, so many seconds at most."""
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self._read(left_s):
                return

    def _read(self, timeout_s: float) -> bool:
        """Take in what there is, waiting for it at most so long; True when a notice was in it."""
        try:
            self._socket.settimeout(max(timeout_s, 0.001))
            chunk = self._socket.recv(CHUNK)
        except TimeoutError:
            return False
        except OSError as error:
            raise self._dialogue.gone(f"the connection ended ({error.strerror or error})") from None
        if not chunk:
            raise self._dialogue.gone("the daemon closed the connection")
        return self._dialogue.receive(chunk)

    def _drain(self) -> None:
        """The daemon's last words, if there are any."""
        deadline_s = time.monotonic() + LAST_WORDS_S
        with suppress(ConnectionLostError):
            while not self._dialogue.farewell and (left_s := deadline_s - time.monotonic()) > 0.0:
                self._read(left_s)

    def close(self) -> None:
        """Give the lease back and disconnect; idempotent."""
        if self._socket.fileno() < 0:
            return
        try:
            with suppress(ConnectionLostError, OSError):
                self.request("release")
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
