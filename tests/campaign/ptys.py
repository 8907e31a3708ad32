"""The fault campaign on wires, in real time: the whole daemon with its real drivers against emulated devices.

``python -m tests.campaign --ptys N`` runs N cases from a seed, some on one daemon, and prints counts. A
case brings the laboratory (`tests.campaign.wires`) into a state, throws one fault switch at a random instant,
perhaps gives an order, heals everything, and has every robot back. A daemon ends by SIGTERM, or by a second
Ctrl-C, in a random state. The session it recorded is then held against the invariants.
"""

from __future__ import annotations

import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.lab import MEMBERS
from contid.client import Client, ConnectionLostError, RemoteError
from contid.control.engine.events import OrderGiven, StopBegan
from contid.remote.protocol.socket_path import is_listening
from contid.session.read import Session
from tests.campaign.exits import limit_s
from tests.campaign.wired_checks import STATES, Injected, Tally, judge
from tests.campaign.wires import RATE_HZ, TOLERANCE_TICKS, Switch, Wires, robot_file
from tests.support.waiting import until

ORDERS: Final = ("", "", "", "estop", "stop", "hold", "resume", "clear_fault")
#: Cases that one daemon sees.
PER_DAEMON: Final = 6
#: From an emergency stop on this side of the socket until no device that answers is driven.
RELAX_S: Final = 0.25
#: Until every chamber is empty: 1.5 bar at the vent rate of the file, and the regulator's lag.
EMPTY_S: Final = 2.5
#: Until a daemon that competes for processors with everything else is up.
START_S: Final = 120.0
#: More have another cause than a busy machine.
MOST_FAILED_STARTS: Final = 5
#: Until every robot is back after everything was healed.
BACK_S: Final = 15.0
#: Until a fault that a healed device reports is latched.
NOTICED_TICKS: Final = TOLERANCE_TICKS + 2
#: Stops that move, so that there is a state STOPPING.
RESTS: Final = dict.fromkeys(("hand_left", "hand_right", "trirack_arm", "cbha_cbha", "tendon3_arm"), "rest")
#: Members of the laboratories; the daemons take turns.
LABS: Final = (MEMBERS, ("hand", "tendon3"))
#: Two places of every axis or tip [mm], by robot; the way between them takes most of a second.
PLACES: Final[dict[str, tuple[dict[str, float], dict[str, float]]]] = {
    **{
        robot: ({"left": 30.0, "right": 30.0}, {"left": 60.0, "right": 60.0})
        for robot in ("hand_left", "hand_right")
    },
    "trirack_arm": tuple({f"s1.l{n}": value for n in (1, 2, 3)} for value in (60.0, 120.0)),  # type: ignore[dict-item]
    "cbha_cbha": tuple(
        {f"s1.l{n}": 100.0 + rise for n in (1, 2, 3)} | {f"s2.l{n}": 90.0 + rise for n in (1, 2, 3)}
        for rise in (5.0, 35.0)
    ),  # type: ignore[dict-item]
    "tendon3_arm": ({"x": 70.0, "y": 10.0, "z": 270.0}, {"x": 10.0, "y": 70.0, "z": 270.0}),
}


#: Switches that restart a board, by its bus. A motor without homing has lost its position then: it must
#: not move until a person has parked it, which no order to the daemon does.
LOSES_POSITION: Final = {"trirack_motors": frozenset({"reset", "brown_out", "freeze"})}

#: What refuses a servo whose encoder stood still while its shaft turned: the position jumps afterwards.
TURN_LOST: Final = "lost its turn count"

#: Deliberate bugs: code that disables a protection in every process of the daemon.
BUGS: Final[dict[str, str]] = {
    "estop skips the devices": (
        "from dataclasses import replace\n"
        "from contid.control.tick import transitions\n"
        "estop = transitions.estop\n"
        "transitions.estop = lambda *given: replace(estop(*given), pending=transitions.Effect.NONE)\n"
    ),
    "estop waits for the end of the motion": (
        "from contid.control.tick import transitions\n"
        "transitions.estop = lambda plan, was, now_s: was if was.mode.name == 'OFF' else transitions.stop(\n"
        "    plan, was, transitions.StopPolicy.RELAX, now_s)\n"
    ),
}


class NotStartedError(Exception):
    """A daemon ended before its robots held: on a busy machine an emulator may not answer in time."""


class Run:
    """One daemon, its wires, and the cases it sees.

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

    def play(self, cases: int) -> None:
        """Several cases, then the end in a random state."""

        def body() -> None:
            for _ in range(cases):
                if not self._case():
                    break
            self._end(self._dice.choice(STATES), twice=self._dice.random() < 0.5)

        self._session(body)

    def stop_everywhere(self, states: Sequence[str]) -> None:
        """An estop in every state, without any fault."""

        def body() -> None:
            for state in states:
                self._bring(state)
                begin_s = time.monotonic()
                self._client.estop()
                self._relaxed(begin_s, state)
                self._tally.check("controllable", self._back())
            self._end("hold", twice=False)

        self._session(body)

    def throw(self, state: str, bus: str, switch: str, axis: str) -> dict[str, str]:
        """One case that is not drawn; states some ticks later."""
        later: dict[str, str] = {}

        def body() -> None:
            self._bring(state)
            chosen = next(each for each in self._wires.switches(bus) if each.name == switch)
            names = [each.name for each in self._wires.buses[bus].axes]
            self._throw(state, bus, chosen, names.index(axis))
            time.sleep(2.0 * NOTICED_TICKS / RATE_HZ)
            later.update(self._state_of())
            self._end("hold", twice=False)

        self._session(body)
        return later

    def interrupt_twice(self, state: str) -> None:
        """Ctrl-C twice in a state, without any fault."""
        self._session(lambda: self._end(state, twice=True))

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
        with suppress(psutil.NoSuchProcess):
            for child in psutil.Process(self._process.pid).children(recursive=True):
                child.kill()
        self._process.kill()
        self._process.wait()

    def _states(self) -> set[str]:
        return set(self._state_of().values())

    def _state_of(self) -> dict[str, str]:
        """State by robot."""
        robots = self._client.status()["robots"]
        return {str(name): str(robot["state"]) for name, robot in robots.items()}

    @property
    def _places(self) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
        """Places of the robots that can be moved."""
        there = self._wires.loaded.file.robots.keys() - self.lost
        return {robot: places for robot, places in PLACES.items() if robot in there}

    # -- one case ------------------------------------------------------------------------------------------

    def _case(self) -> bool:
        """False when not every robot could be had back: the daemon ends."""
        dice = self._dice
        state = STATES[(self._number * PER_DAEMON + self._tally.cases) % len(STATES)]
        self._bring(state)
        time.sleep(dice.uniform(0.0, 0.15))
        bus = dice.choice(sorted(self._wires.buses))
        switch = dice.choice(self._wires.switches(bus))
        axis = dice.randrange(len(self._wires.buses[bus].axes))
        return self._throw(state, bus, switch, axis)

    def _throw(self, state: str, bus: str, switch: Switch, axis: int) -> bool:
        """One switch on, perhaps an order, every switch off; False when not every robot could be had back."""
        dice, tally = self._dice, self._tally
        axes = [axis.name for axis in self._wires.buses[bus].axes]
        robots = frozenset(name.split(".")[0] for name in axes)
        concerned = frozenset({axes[axis].split(".")[0]}) if switch.on_axis else robots
        injected = Injected(bus, switch, state, robots, concerned, time.monotonic())
        self._wires.throw(bus, switch, axis, dice)
        self._injected.append(injected)
        tally.cases += 1
        tally.faults[f"{self._wires.buses[bus].wiring.driver} {switch.name}", state] += 1
        order = dice.choice(ORDERS)
        if order:
            time.sleep(dice.uniform(0.0, 0.3))
            injected.order_s = time.monotonic()
            self._order(order)
            if order == "estop":
                # A faulty device may miss it; the others must not.
                self._relaxed(injected.order_s, state, frozenset({axes[axis]} if switch.on_axis else axes))
        time.sleep(dice.uniform(0.4, 0.6))
        injected.until_s = time.monotonic()
        if switch.name in LOSES_POSITION.get(bus, ()):
            self.lost = robots
        self._wires.heal()
        # What a healed switch leaves behind, as a position that jumps, is of this case and not of the next.
        noticed = self._tick() + NOTICED_TICKS
        until(lambda: self._tick() > noticed, "the daemon has seen the healed devices")
        back = self._back()
        injected.latest_s = time.monotonic()
        tally.check("controllable", back)
        return not back and not self.lost

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

    def _bring(self, state: str) -> None:
        """Into a state; a robot or two may have another one, by chance."""
        client, dice = self._client, self._dice
        client.acquire(60.0, takeover=True)
        self._place = 1 - self._place
        if state == "run":
            columns, rows = self._rows()
            begun = self._insist(lambda: client.request("move", columns=columns))
            if begun is None:
                return
            client.request("rows", move=begun["move"], rows=rows)
            client.request("end", move=begun["move"])
            until(lambda: "RUN" in self._states() or "FAULT" in self._states(), "it runs")
            return
        if state in ("approach", "stopping"):
            target = {
                f"{robot}.{axis}_mm": value
                for robot, places in self._places.items()
                for axis, value in places[self._place].items()
            }
            self._insist(lambda: client.move(target, wait=False))
            time.sleep(dice.uniform(0.05, 0.3))
        if state == "stopping":
            client.stop()
        elif state == "fault":
            eyes = dice.choice(self._wires.servos)
            robot = frozenset({eyes.axis.split(".")[0]})
            bus = next(
                name
                for name in self._wires.benches
                if eyes.axis in {axis.name for axis in self._wires.buses[name].axes}
            )
            emulator = self._wires.benches[bus].emulator
            by_hand = Injected(bus, Switch("trip", True), state, robot, robot, time.monotonic())
            by_hand.latest_s = math.inf
            self._injected.append(by_hand)
            emulator.set("trip", eyes.servo.device)
            until(lambda: "FAULT" in self._states(), "FAULT")
        elif state == "arming":
            client.estop()
            self._order("resume")

    def _rows(self) -> tuple[list[str], list[list[float]]]:
        """Every axis up and down, slowly enough for all of them."""
        columns, middles = ["t_s"], []
        for robot, (low, high) in self._places.items():
            for axis in low:
                columns.append(f"{robot}.{axis}_mm")
                middles.append((low[axis] + high[axis]) / 2.0)
        rows = []
        for row in range(100):
            swing = 8.0 * math.sin(row / 100 * math.tau * 3.0)
            rows.append([0.05 * row, *(middle + swing for middle in middles)])
        return columns, rows

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

    # -- the end -------------------------------------------------------------------------------------------

    def _end(self, state: str, twice: bool) -> None:
        dice, tally = self._dice, self._tally
        self._bring(state)
        time.sleep(dice.uniform(0.0, 0.1))
        family = [psutil.Process(self._process.pid)]
        family += family[0].children(recursive=True)
        begin_s = time.monotonic()
        self._process.send_signal(signal.SIGTERM)
        if twice:
            time.sleep(0.05)
            begin_s = time.monotonic()
            self._process.send_signal(signal.SIGINT)
        alive = family
        while alive and time.monotonic() < begin_s + 15.0:
            self._process.poll()
            alive = [each for each in alive if _alive(each)]
            time.sleep(0.002)
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


def _alive(process: psutil.Process) -> bool:
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def campaign(
    cases: int,
    seed: int,
    progress: Callable[[Tally], None] | None = None,
    driver: str = "",
    keep: Path | None = None,
) -> Tally:
    """Run cases, several of them with each daemon, on the buses of a driver or on all.

    Sessions that broke an invariant are copied to the folder ``keep``.
    """
    tally, begin_s = Tally(seed, keep=keep), time.monotonic()
    number = 0
    while tally.cases < cases:
        before = tally.cases
        run = Run(random.Random(f"{seed}:{number}"), tally, number, driver=driver)
        number += 1
        try:
            run.play(min(PER_DAEMON, cases - tally.cases))
        except NotStartedError as error:
            tally.failed_starts.append(str(error))
            if len(tally.failed_starts) > MOST_FAILED_STARTS:
                raise
            continue
        tally.seconds = time.monotonic() - begin_s
        if progress is not None:
            progress(tally)
        if tally.cases == before:
            break
    return tally
