"""The fault campaign on wires, in real time: the whole daemon with its real drivers against emulated devices.

``python -m tests.campaign --ptys N`` runs N cases from a seed, some on one daemon, and prints counts. A
case brings the laboratory (`tests.campaign.wires`) into a state, throws one fault switch at a random instant,
perhaps gives an order, heals everything, and has every robot back. A daemon ends by SIGTERM, or by a second
Ctrl-C, in a random state. The session it recorded is then held against the invariants.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import psutil

from contid.client import Client, ConnectionLostError, RemoteError
from contid.control.record import ENABLED, TickRecord
from contid.control.supervisor import Mode
from contid.control.wiring import build_plans
from contid.session.read import Session
from tests.campaign import invariants
from tests.campaign.wires import RATE_HZ, Switch, Wires, robot_file
from tests.remote.daemons import until

STATES: Final = ("approach", "run", "hold", "stopping", "fault", "arming")
ORDERS: Final = ("", "", "", "estop", "stop", "hold", "resume", "clear_fault")
#: Cases that one daemon sees.
PER_DAEMON: Final = 6
#: From SIGTERM, or the second Ctrl-C, to the end of every process; a stop that moves takes its motion on top.
EXIT_S: Final = 2.0
#: From an emergency stop on this side of the socket until no device that hears is driven.
RELAX_S: Final = 0.25
#: Until every chamber is empty: 1.5 bar at the vent rate of the file, and the regulator's lag.
EMPTY_S: Final = 2.5
#: Until every robot is back after everything was healed.
BACK_S: Final = 15.0
#: Stops that move, so that there is a state STOPPING.
RESTS: Final = dict.fromkeys(("hand_left", "hand_right", "trirack_arm", "cbha_cbha"), "rest")
#: Two places of every axis [mm], by robot; the way between them takes most of a second.
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
}

INVARIANTS: Final = (
    "goals at the servos", "outputs of the boards", "position limits", "velocity and acceleration limits",
    "no jump on arming", "estop within the tick", "fault within the stated ticks",
    "other robots unaffected", "estop at the devices",
    "session complete", "controllable", "exit within 2 s", "nothing left behind",
)  # fmt: skip


@dataclass
class Injected:
    """One fault switch that was thrown."""

    bus: str
    switch: Switch
    state: str
    robots: frozenset[str]
    at_s: float
    until_s: float = 0.0
    order_s: float = float("inf")
    latest_s: float = 0.0


@dataclass
class Tally:
    """What a campaign on wires counted."""

    seed: int
    cases: int = 0
    daemons: int = 0
    seconds: float = 0.0
    checks: Counter[str] = field(default_factory=Counter)
    violations: Counter[str] = field(default_factory=Counter)
    faults: Counter[tuple[str, str]] = field(default_factory=Counter)
    times: dict[str, list[float]] = field(default_factory=dict)
    words: list[str] = field(default_factory=list)

    def check(self, name: str, found: list[str]) -> None:
        assert name in INVARIANTS
        self.checks[name] += 1
        self.violations[name] += bool(found)
        self.words += [f"{name}: {words}" for words in found[:3]]

    def time(self, what: str, seconds: float) -> None:
        self.times.setdefault(what, []).append(seconds)

    def table(self) -> str:
        lines = [
            f"{self.cases} cases on {self.daemons} daemons in real time, seed {self.seed}, "
            f"{self.seconds:.0f} s",
            "",
            f"{'invariant':<36}{'checks':>8}{'violations':>12}",
            *(f"{name:<36}{self.checks[name]:>8}{self.violations[name]:>12}" for name in INVARIANTS),
            "",
            "fault switches thrown, by state:",
            " " * 20 + "".join(f"{state:>10}" for state in STATES),
        ]
        for kind in sorted({kind for kind, _ in self.faults}):
            lines.append(f"{kind:<20}" + "".join(f"{self.faults[kind, state]:>10}" for state in STATES))
        lines.append("")
        for what, times in sorted(self.times.items()):
            middle, worst = sorted(times)[len(times) // 2] * 1e3, max(times) * 1e3
            lines.append(f"{what:<52}{len(times):>4} times, median {middle:6.0f} ms, worst {worst:6.0f} ms")
        return "\n".join([*lines, *(["", *self.words[:20]] if self.words else [])])


class Run:
    """One daemon, its wires, and the cases it sees."""

    def __init__(self, dice: random.Random, tally: Tally, number: int) -> None:
        self._dice, self._tally = dice, tally
        self._number = number
        self._injected: list[Injected] = []
        self._place = 0

    def play(self, cases: int) -> None:
        """Start, run so many cases, end, and judge."""
        # Short: the path of a socket has 107 bytes.
        with tempfile.TemporaryDirectory(prefix="contid-") as folder, ExitStack() as stack:
            self._folder = Path(folder)
            self._path = robot_file(self._folder, RESTS)
            self._wires = stack.enter_context(Wires(self._path))
            self._start(stack)
            try:
                for _ in range(cases):
                    if not self._case():
                        break
                self._end()
            except ConnectionLostError as error:
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(5.0)
                said = self._said.read_text(errors="replace")
                last = self._injected[-1] if self._injected else None
                self._tally.check("controllable", [f"{error}: {said[-2000:]} after {last}"])
            self._judge()
        self._tally.daemons += 1

    def _start(self, stack: ExitStack) -> None:
        socket = self._folder / "s"
        command = [sys.executable, "-m", "contid", "run", str(self._path), "--socket", str(socket)]
        self._said = self._folder / "said"
        with self._said.open("wb") as said:
            self._process = subprocess.Popen(
                [*command, "--record", str(self._folder / "s.mcap")],
                stdin=subprocess.DEVNULL, stdout=said, stderr=said,
            )  # fmt: skip
        stack.callback(self._kill)
        until(lambda: socket.exists() or self._process.poll() is not None, "the daemon listens")
        assert self._process.poll() is None, self._said.read_text()
        self._client = stack.enter_context(Client(socket, name="campaign"))
        self._client.take(60.0)
        until(lambda: self._states() == {"HOLD"}, "armed")

    def _kill(self) -> None:
        with suppress(psutil.NoSuchProcess):
            for child in psutil.Process(self._process.pid).children(recursive=True):
                child.kill()
        self._process.kill()
        self._process.wait()

    def _states(self) -> set[str]:
        return {str(robot["state"]) for robot in self._client.status()["robots"].values()}

    # -- one case ------------------------------------------------------------------------------------------

    def _case(self) -> bool:
        """False when the robots could not be had back."""
        dice, tally = self._dice, self._tally
        state = STATES[(self._number * PER_DAEMON + tally.cases) % len(STATES)]
        self._bring(state)
        time.sleep(dice.uniform(0.0, 0.15))
        bus = dice.choice(sorted(self._wires.buses))
        switch = dice.choice(self._wires.switches(bus))
        axes = [axis.name for axis in self._wires.buses[bus].axes]
        axis = dice.randrange(len(axes))
        robots = frozenset(name.split(".")[0] for name in axes)
        injected = Injected(bus, switch, state, robots, time.monotonic())
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
                self._relaxed(injected, axes[axis] if switch.on_axis else "")
        time.sleep(dice.uniform(0.4, 0.6))
        injected.until_s = time.monotonic()
        self._wires.heal()
        back = self._back()
        injected.latest_s = time.monotonic()
        tally.check("controllable", back)
        return not back

    def _order(self, order: str) -> None:
        with suppress(RemoteError):  # its state may refuse it
            getattr(self._client, order)()

    def _bring(self, state: str) -> None:
        """Into a state; a robot or two may have another one, by chance."""
        client, dice = self._client, self._dice
        client.take(60.0, takeover=True)
        self._place = 1 - self._place
        if state == "run":
            columns, rows = self._rows()
            begun = client.request("move", columns=columns)
            client.request("rows", move=begun["move"], rows=rows)
            client.request("end", move=begun["move"])
            until(lambda: "RUN" in self._states() or "FAULT" in self._states(), "it runs")
            return
        if state in ("approach", "stopping"):
            target = {
                f"{robot}.{axis}_mm": value
                for robot, places in PLACES.items()
                for axis, value in places[self._place].items()
            }
            client.move(target, wait=False)
            time.sleep(dice.uniform(0.05, 0.3))
        if state == "stopping":
            client.stop()
        elif state == "fault":
            emulator = next(iter(self._wires.benches.values())).emulator
            emulator.set("trip", dice.choice(emulator.servos).device)
            until(lambda: "FAULT" in self._states(), "FAULT")
        elif state == "arming":
            client.estop()
            client.request("resume")

    def _rows(self) -> tuple[list[str], list[list[float]]]:
        """Every axis up and down, slowly enough for all of them."""
        import math

        columns, middles = ["t_s"], []
        for robot, (low, high) in PLACES.items():
            for axis in low:
                columns.append(f"{robot}.{axis}_mm")
                middles.append((low[axis] + high[axis]) / 2.0)
        rows = []
        for row in range(100):
            swing = 8.0 * math.sin(row / 100 * math.tau * 3.0)
            rows.append([0.05 * row, *(middle + swing for middle in middles)])
        return columns, rows

    def _relaxed(self, injected: Injected, deaf: str) -> None:
        """After an estop no output is driven, of the devices that hear."""
        dead = {axis.name for axis in self._wires.buses[injected.bus].axes} if not deaf else {deaf}
        # A faulty device may not hear; the others have to.
        while still := set(self._wires.driven()) - dead:
            if time.monotonic() > injected.order_s + EMPTY_S:
                break
            time.sleep(0.002)
        took_s = self._wires.resting_s(injected.order_s)
        late = [] if took_s < RELAX_S else [f"{took_s * 1e3:.0f} ms in {injected.state}"]
        driven = [f"{', '.join(sorted(still))} driven in {injected.state}"] if still else []
        self._tally.check("estop at the devices", driven or late)
        self._tally.time("estop: until the last output is off, at the devices", took_s)

    def _back(self) -> list[str]:
        """Clear and resume until every robot holds."""
        deadline_s = time.monotonic() + BACK_S
        words = ""
        while time.monotonic() < deadline_s:
            try:
                self._client.take(60.0, takeover=True)
                if "FAULT" in self._states():
                    self._client.clear_fault()
                self._client.resume()
                states = self._states()
            except RemoteError as error:
                words = str(error)
                time.sleep(0.05)
                continue
            if states <= {"HOLD", "RUN"}:
                self._client.hold()
                return []
            time.sleep(0.05)
        return [f"{self._states()}: {words} after {self._injected[-1]}"]

    # -- the end -------------------------------------------------------------------------------------------

    def _end(self) -> None:
        dice, tally = self._dice, self._tally
        state, twice = dice.choice(STATES), dice.random() < 0.5
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
            "exit within 2 s", [f"{what} in {state}: {took_s:.2f} s"] if took_s - moved_s > EXIT_S else []
        )
        left = [f"process {each.pid}" for each in alive]
        left += [f"ring {path}" for path in Path("/dev/shm").glob(f"contid-{self._process.pid}-*")]
        left += ["its socket"] if (self._folder / "s").exists() else []
        said = self._said.read_text(errors="replace")
        left += [said] if "Traceback" in said else []
        tally.check("nothing left behind", left)
        if twice:
            while (driven := self._wires.driven()) and time.monotonic() < begin_s + EMPTY_S:
                time.sleep(0.002)
            relax_s = self._wires.resting_s(begin_s)
            if relax_s > 0.0:
                tally.time("second Ctrl-C: until the last output is off, at the devices", relax_s)
            late = [f"{relax_s * 1e3:.0f} ms"] if relax_s > RELAX_S else []
            tally.check(
                "estop at the devices", [f"{driven} driven after Ctrl-C in {state}"] if driven else late
            )

    def _motion_s(self) -> float:
        events = Session(self._folder / "s.mcap").events()
        return max((float(e["seconds"]) for e in events if e["event"] == "stopping"), default=0.0)

    def _judge(self) -> None:
        """The recorded session, and what the devices saw, against the invariants."""
        tally, wires = self._tally, self._wires
        tally.check("goals at the servos", [words for eyes in wires.servos for words in eyes.wrong])
        tally.check("outputs of the boards", [words for eyes in wires.channels for words in eyes.wrong])
        session = Session(self._folder / "s.mcap")
        records, events = list(session.ticks()), list(session.events())
        plans = build_plans(wires.loaded, RATE_HZ)
        machine = SimpleNamespace(plans=plans, loaded=wires.loaded)
        seen: Any = SimpleNamespace(case=SimpleNamespace(machine=machine), records=records, events=events)
        tally.check("position limits", list(invariants.position(seen)))
        tally.check("velocity and acceleration limits", list(invariants.rates(seen)))
        tally.check(
            "session complete", [*([] if session.clean else [session.cut]), *invariants.complete(seen)]
        )
        tally.check("no jump on arming", list(_no_jump(plans, records)))
        by_tick = {record.tick: record.deadline_s for record in records}
        faults = [
            (by_tick.get(e["tick"], 0.0), e["robot"], e["words"]) for e in events if e["event"] == "fault"
        ]
        tally.check("other robots unaffected", list(self._unaffected(faults)))
        tally.check("estop within the tick", list(_estops(plans, records, events)))
        for injected in self._injected:
            self._detected(injected, records, plans)

    def _unaffected(self, faults: list[tuple[float, str, str]]) -> Iterator[str]:
        """Every fault has a switch on its own bus that was on, or had just been."""
        hand = {"hand_left", "hand_right"}  # `_bring` trips a servo
        for at_s, robot, words in faults:
            if robot in hand and any(i.state == "fault" for i in self._injected):
                continue
            if not any(
                robot in i.robots and i.at_s - 0.05 <= at_s <= i.latest_s + 0.5 for i in self._injected
            ):
                yield f"{robot}: {words}"

    def _detected(self, injected: Injected, records: list[TickRecord], plans: Any) -> None:
        """A watched robot of a bus in trouble is in FAULT within the stated ticks."""
        if not injected.switch.must:
            return
        # A bus takes its time-outs to answer, and the machine some ticks to be on time.
        allowed_s = (injected.switch.ticks + 2) / RATE_HZ + 0.1
        end_s = min(injected.until_s, injected.order_s)
        found: list[str] = []
        if end_s - injected.at_s > allowed_s:
            watched = [r for r in records if injected.at_s - 0.5 / RATE_HZ <= r.deadline_s <= end_s]
            first = {}
            for index, plan in enumerate(plans):
                if plan.name not in injected.robots or not watched:
                    continue
                modes = [Mode(record.robots[index].mode) for record in watched]
                if modes[0] in (Mode.APPROACH, Mode.RUN, Mode.HOLD) and Mode.FAULT in modes:
                    first[plan.name] = watched[modes.index(Mode.FAULT)].deadline_s - injected.at_s
                elif modes[0] in (Mode.APPROACH, Mode.RUN, Mode.HOLD):
                    first[plan.name] = float("inf")
            # A switch of one axis concerns the robot of that axis only.
            if first:
                took_s = min(first.values())
                if took_s > allowed_s:
                    found.append(f"{injected.bus} {injected.switch.name} in {injected.state}: {first}")
                else:
                    self._tally.time(f"FAULT after {injected.switch.name}", took_s)
        self._tally.check("fault within the stated ticks", found)


def _alive(process: psutil.Process) -> bool:
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def _no_jump(plans: Any, records: list[TickRecord]) -> Iterator[str]:
    """The first command after arming is what was measured."""
    for index, plan in enumerate(plans):
        armed = False
        for old, new in pairwise(records):
            was, now = old.robots[index], new.robots[index]
            commanded = now.axes[0].device == now.axes[0].device
            if commanded and not armed:
                armed = True
                for a, b in zip(now.axes, was.axes, strict=True):
                    # Pressures are noisy by some hundred Pa, shafts by their counts.
                    # A shaft that still turns goes on between the reading and the arming.
                    room = 3000.0 if abs(a.device) > 100.0 else 0.02 + 2.0 / RATE_HZ * abs(b.velocity)
                    if not abs(a.device - b.value) <= room:
                        yield f"{plan.name}: begins at {a.device}, measured {b.value}, tick {new.tick}"
                        return
            if not now.flags & ENABLED:
                armed = False


def _estops(plans: Any, records: list[TickRecord], events: list[Any]) -> Iterator[str]:
    """In the tick of an estop no robot is commanded any more: OFF, or a fault that was latched already."""
    by_tick = {record.tick: record for record in records}
    for event in events:
        if event["event"] != "order" or event["order"] != "estop" or event["tick"] not in by_tick:
            continue
        for plan, robot in zip(plans, by_tick[event["tick"]].robots, strict=True):
            commanded = any(axis.device == axis.device for axis in robot.axes)
            if robot.mode not in (Mode.OFF, Mode.FAULT) or commanded or robot.flags & ENABLED:
                yield f"{plan.name}: {Mode(robot.mode).name} in the tick of an estop, {event['tick']}"


def campaign(
    cases: int, seed: int, progress: Callable[[Tally], None] | None = None, per_daemon: int = PER_DAEMON
) -> Tally:
    """So many cases, each daemon sees some of them."""
    tally, begin_s = Tally(seed), time.monotonic()
    number = 0
    while tally.cases < cases:
        before = tally.cases
        Run(random.Random(f"{seed}:{number}"), tally, number).play(min(per_daemon, cases - tally.cases))
        number += 1
        tally.seconds = time.monotonic() - begin_s
        if progress is not None:
            progress(tally)
        if tally.cases == before:
            break
    return tally
