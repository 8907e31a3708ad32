"""The loop that moves emulated bodies in real time, and hands the tips that trackers measure to a daemon."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from contid.client import Client, Code, ConnectionLostError, NoDaemonError, RemoteError
from contid.errors import ContidError
from contid.hal import TipMeasured
from contid.units import MM_PER_M
from contid_emulate.bodies import LOOK_S, EmulatedBodies

#: Time between two tries to reach a daemon.
_AGAIN_S: Final = 0.5


class DaemonTracker:
    """Hands tips to the daemon that runs, whenever one does.

    Args:
        socket: of the daemon; None for the only one that runs.
        notify: gets each message once.
    """

    def __init__(self, socket: str | None, notify: Callable[[str], None]) -> None:
        self._socket, self._notify = socket, notify
        self._named: set[str] = set()
        self._known: set[str] = set()
        self._client: Client | None = None
        self._next_try_s = self._since_s = 0.0

    def send(self, tips: Sequence[TipMeasured]) -> None:
        """Hand tips on; without a daemon, or where it refuses them, they are lost."""
        # Of a robot's tips that arrive together the newest is of use, none that is older than the connection.
        newest = {tip.robot: tip for tip in tips}
        if not newest or (self._client is None and not self._reached()):
            return
        assert self._client is not None
        try:
            for tip in newest.values():
                if tip.time_s >= self._since_s:
                    self._hand(self._client, tip)
        except ConnectionLostError:
            self.close()  # this daemon has ended; the next one is tracked as well

    def _hand(self, client: Client, tip: TipMeasured) -> None:
        """The first of each robot waits for its answer: with a daemon that starts it is too old."""
        tip_mm = [MM_PER_M * each for each in tip.tip_in_world_m]
        if tip.robot not in self._known:
            self._known.add(tip.robot)
            try:
                client.measure(tip_mm, robot=tip.robot, time_s=tip.time_s)
            except RemoteError as error:
                if error.code != Code.BAD_MEASUREMENT:
                    self._name(error)
            return
        for refused in client.track(tip_mm, tip.time_s, robot=tip.robot):
            self._name(refused)

    def close(self) -> None:
        """Leave the daemon."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _reached(self) -> bool:
        if time.monotonic() < self._next_try_s:
            return False
        self._next_try_s = time.monotonic() + _AGAIN_S
        try:
            self._client = Client(self._socket, name="emulated tracker")
            self._client.status()  # a daemon that starts takes its time
        except ContidError as error:
            self.close()
            if not isinstance(error, (NoDaemonError, ConnectionLostError)):
                self._name(error)
            return False
        self._known, self._since_s = set(), time.monotonic()
        return True

    def _name(self, error: Exception) -> None:
        # A tip out of reach or too old: its numbers differ each time.
        kind = (
            "measurement"
            if isinstance(error, RemoteError) and error.code == Code.BAD_MEASUREMENT
            else str(error)
        )
        if kind not in self._named:
            self._named.add(kind)
            self._notify(f"tracker: {error}")


@contextmanager
def moving(
    bodies: EmulatedBodies, tracker: DaemonTracker | None, notify: Callable[[str], None]
) -> Iterator[None]:
    """Bodies move in a thread of their own while the context lasts."""
    ended = threading.Event()

    def run() -> None:
        next_s = time.monotonic()
        while not ended.wait(max(0.0, next_s - time.monotonic())):
            now_s = time.monotonic()
            next_s = max(next_s + LOOK_S, now_s)
            try:
                tips = bodies.advance(now_s)
            except (
                ContidError
            ) as error:  # its emulated board has crashed, which the end of the command reports
                notify(f"bodies no longer move: {error}")
                return
            if tracker is not None:
                tracker.send(tips)

    thread = threading.Thread(target=run, name="emulated-bodies", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        if tracker is not None:
            tracker.close()
