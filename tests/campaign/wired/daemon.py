"""One daemon of the campaign on wires: its laboratory, its start, its states and its recovery."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.lab import MEMBERS
from contid.client import Client, ConnectionLostError, RemoteError
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.events.run import StopBegan
from contid.remote.protocol.socket_path import is_listening
from contid.session.read import Session
from tests.campaign.ended_daemons import kill_family, left_alive, limit_s
from tests.campaign.wired.checks import Injected, Tally, judge
from tests.campaign.wired.lab_file import RATE_HZ, robot_file
from tests.campaign.wired.wires import Wires
from tests.support.waiting import until

#: From an emergency stop on this side of the socket until no device that answers is driven.
RELAX_S: Final = 0.25
#: Until every chamber is empty: 1.5 bar at the vent rate of the file, and the regulator's lag.
EMPTY_S: Final = 2.5
#: Until a daemon that competes for processors with everything else is up.
START_S: Final = 120.0
#: Until every robot is back after everything was healed.
BACK_S: Final = 15.0
#: Stops that move, so that there is a state STOPPING.
RESTS: Final = dict.fromkeys(("hand_left", "hand_right", "trirack_arm", "cbha_cbha", "tendon3_arm"), "rest")
#: Members of the laboratories; the daemons take turns.
LABS: Final = (MEMBERS, ("hand", "tendon3"))

#: What refuses a servo whose encoder stood still while its shaft turned: the position jumps afterwards.
TURN_LOST: Final = "lost its turn count"


class NotStartedError(Exception):
    """A daemon ended before its robots held: on a busy machine an emulator may not answer in time."""


class WiredDaemon:
    """One daemon and its wires.

    Attributes:
        lost: robots that lost their position; they stay in FAULT.
    """

    def __init__(
        self, dice: random.Random, tally: Tally, number: int, bug: str = "", driver: str = ""
    ) -> None:
        """Prepare.

        Args:
            dice: choose everything.
            tally: counts.
            number: of the daemon.
            bug: code of `BUGS`, run by every process of the daemon before anything else.
            driver: only its buses.
        """
        self._driver = driver
        self._dice, self._tally = dice, tally
        self._number = number
        self._bug = bug
        self._injected: list[Injected] = []
        self._place = 0
        self.lost: frozenset[str] = frozenset()

    def _session(self, body: Callable[[], None]) -> None:
        """Start, do what is asked, and judge."""
        # Short: the path of a socket has 107 bytes.
        with tempfile.TemporaryDirectory(prefix="contid-") as folder:
            self._folder = Path(folder)
            self._path = robot_file(self._folder, RESTS, self._driver, LABS[self._number % len(LABS)])
            self._wires = Wires(self._path)
            with self._wires, ExitStack() as stack:
                self._start(stack)
                try:
                    body()
                except ConnectionLostError as error:
                    with suppress(subprocess.TimeoutExpired):
                        self._process.wait(5.0)
                    stderr = self._stderr.read_text(errors="replace")
                    last = self._injected[-1] if self._injected else None
                    self._tally.check("controllable", [f"{error}: {stderr[-2000:]} after {last}"])
            judge(self._tally, self._wires, self._folder / "s.mcap", self._injected)
        self._tally.daemons += 1

    def _start(self, stack: ExitStack) -> None:
        socket = self._folder / "s"
        command = [sys.executable, "-m", "contid", "run", str(self._path), "--socket", str(socket)]
        self._stderr = self._folder / "stderr"
        # Python imports a module of this name, if there is one, before anything else.
        (self._folder / "sitecustomize.py").write_text(self._bug)
        paths = [str(self._folder), *sys.path[1:]] if self._bug else [*sys.path[1:]]
        with self._stderr.open("wb") as stderr:
            self._process = subprocess.Popen(
                [*command, "--record", str(self._folder / "s.mcap")],
                stdin=subprocess.DEVNULL, stdout=stderr, stderr=stderr,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
            )  # fmt: skip
        stack.callback(self._kill)
        until(lambda: is_listening(socket) or self._process.poll() is not None, "it listens", START_S)
        assert self._process.poll() is None, self._stderr.read_text()
        self._client = stack.enter_context(Client(socket, name="campaign", timeout_s=60.0))
        self._client.acquire(60.0)
        try:
            until(lambda: self._states() == {"HOLD"}, "armed", START_S)
        except (ConnectionLostError, AssertionError) as error:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(5.0)
            raise NotStartedError(f"not armed: {error}: {self._stderr.read_text()}") from error

    def _kill(self) -> None:
        kill_family(self._process)

    def _states(self) -> set[str]:
        return set(self._state_of().values())

    def _state_of(self) -> dict[str, str]:
        """State by robot."""
        robots = self._client.status()["robots"]
        return {str(name): str(robot["state"]) for name, robot in robots.items()}

    def _tick(self) -> int:
        return int(self._client.status()["tick"])

    def _order(self, order: str) -> str:
        """Give an order; its refusal, which the state of a robot may be the reason for."""
        try:
            getattr(self._client, order)()
        except RemoteError as error:
            return str(error)
        return ""

    def _insist(self, order: Callable[[], Any]) -> Any:
        """Give an order, again if a robot went to FAULT meanwhile; `judge` decides whether with a cause."""
        try:
            return order()
        except RemoteError:
            self._tally.check("controllable", self._back())
        try:
            return order()
        except RemoteError as error:
            self._tally.check("controllable", [str(error)])
            return None

    def _relaxed(
        self, since_s: float, state: str, deaf: frozenset[str] = frozenset(), way: str = "estop"
    ) -> None:
        """No output is driven any more, and no chamber has pressure, of the devices that answer."""
        while still := set(self._wires.driven()) - deaf:
            if time.monotonic() > since_s + EMPTY_S:
                break
            time.sleep(0.002)
        took_s = self._wires.resting_s(since_s)
        late = [] if took_s < RELAX_S else [f"{way}: {took_s * 1e3:.0f} ms in {state}"]
        driven = [f"{way}: {', '.join(sorted(still))} driven in {state}"] if still else []
        self._tally.check("estop at the devices", driven or late)
        if took_s > 0.0:
            self._tally.time(f"{way}: until the last output is off, at the devices", took_s)

    def _back(self) -> list[str]:
        """Clear and resume until every robot holds; one that lost its position must stay in FAULT."""
        deadline_s = time.monotonic() + BACK_S
        refusal = ""
        while time.monotonic() < deadline_s:
            self._client.acquire(60.0, takeover=True)
            if "FAULT" in self._states():
                refusal = self._order("clear_fault") or refusal
            refusal = self._order("resume") or refusal
            if TURN_LOST in refusal and self._injected[-1].switch.name == "freeze":
                self.lost |= self._injected[-1].concerned
            states = self._state_of()
            back = {state for robot, state in states.items() if robot not in self.lost}
            latched = all(states[robot] == "FAULT" for robot in self.lost)
            lost = "position lost" in refusal or TURN_LOST in refusal
            if back <= {"HOLD", "RUN"} and (not self.lost or (latched and lost)):
                self._order("hold")
                return []
            time.sleep(0.05)
        return [f"{self._state_of()}: {refusal} after {self._injected[-1:]}"]

    def _terminate(self, state: str, twice: bool) -> None:
        """End the daemon by SIGTERM, or by a second Ctrl-C."""
        tally = self._tally
        family = [psutil.Process(self._process.pid)]
        family += family[0].children(recursive=True)
        begin_s = time.monotonic()
        self._process.send_signal(signal.SIGTERM)
        if twice:
            time.sleep(0.05)
            begin_s = time.monotonic()
            self._process.send_signal(signal.SIGINT)
        alive = left_alive(self._process, family, begin_s + 15.0)
        took_s = time.monotonic() - begin_s
        moved_s = 0.0 if twice else self._motion_s()
        what = "second Ctrl-C" if twice else "SIGTERM, without the motion of its stop"
        tally.time(f"{what}: until the last process is gone", took_s - moved_s)
        tally.check(
            "exit within 2 s", [f"{what} in {state}: {took_s:.2f} s"] if took_s - moved_s > limit_s() else []
        )
        left = [f"process {each.pid}" for each in alive]
        left += [f"ring {path}" for path in Path("/dev/shm").glob(f"contid-{self._process.pid}-*")]
        left += ["its socket"] if (self._folder / "s").exists() else []
        stderr = self._stderr.read_text(errors="replace")
        left += [stderr] if "Traceback" in stderr else []
        tally.check("nothing left behind", left)
        if twice and not self._had_ended(begin_s):
            self._relaxed(begin_s, state, way="second Ctrl-C")

    def _had_ended(self, at_s: float) -> bool:
        """The orderly stop, which leaves devices at rest by its policy, ended before the second Ctrl-C."""
        session = Session(self._folder / "s.mcap")
        orders = [str(event.order["order"]) for event in session.events() if isinstance(event, OrderGiven)]
        pressed = "estop" in orders[orders.index("finish") :] if "finish" in orders else False
        *_, last = session.ticks()
        return not pressed and last.deadline_s < at_s + 1.0 / RATE_HZ

    def _motion_s(self) -> float:
        events = Session(self._folder / "s.mcap").events()
        return max((e.seconds for e in events if isinstance(e, StopBegan)), default=0.0)
