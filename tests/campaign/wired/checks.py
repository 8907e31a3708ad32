"""What must hold of a run on wires: its session, and what the devices saw, against the invariants."""

from __future__ import annotations

import math
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from contid.control.engine.events.robots import FaultLatched, OrderGiven
from contid.control.engine.tick_layout import ENABLED, TickRecord
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.supervisor import Mode
from contid.session.read import Session
from contid_sessions.check import check_session
from tests.campaign import invariants, motion_invariants
from tests.campaign.wired.lab_file import RATE_HZ
from tests.campaign.wired.switches import Switch
from tests.campaign.wired.wires import Wires

STATES: Final = ("approach", "run", "hold", "stopping", "fault", "arming")
#: Robots whose devices are regulators.
PRESSURES: Final = ("cbha_cbha",)

INVARIANTS: Final = (
    "goals at the servos", "outputs of the boards", "position limits", "velocity and acceleration limits",
    "no jump on arming", "estop within the tick", "fault within the stated ticks",
    "other robots unaffected", "estop at the devices",
    "session complete", "session check", "controllable", "exit within 2 s", "nothing left behind",
)  # fmt: skip


@dataclass
class Injected:
    """One fault switch that was thrown."""

    bus: str
    switch: Switch
    state: str
    robots: frozenset[str]
    concerned: frozenset[str]
    at_s: float
    until_s: float = 0.0
    order_s: float = float("inf")
    latest_s: float = 0.0


#: Exchange of a servo bus with a silent servo: `lab_file.LONG_TIMEOUTS` and its bytes.
TIMEOUT_S: Final = 0.018


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
    message: list[str] = field(default_factory=list)
    failed_starts: list[str] = field(default_factory=list)
    keep: Path | None = None

    def check(self, name: str, found: list[str]) -> None:
        assert name in INVARIANTS
        self.checks[name] += 1
        self.violations[name] += bool(found)
        self.message += [f"{name}: {message}" for message in found[:3]]

    def time(self, what: str, seconds: float) -> None:
        self.times.setdefault(what, []).append(seconds)

    def table(self) -> str:
        lines = [
            f"{self.cases} cases on {self.daemons} daemons in real time, seed {self.seed}, "
            f"{self.seconds:.0f} s",
            *(
                ["", f"starts that failed: {len(self.failed_starts)}", *self.failed_starts]
                if self.failed_starts
                else []
            ),
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
        return "\n".join([*lines, *(["", *self.message[:20]] if self.message else [])])


def judge(tally: Tally, wires: Wires, recorded: Path, thrown: Sequence[Injected]) -> None:
    """The recorded session and what the devices saw against the invariants; what broke one is kept."""
    before = sum(tally.violations.values())
    _judge(tally, wires, recorded, thrown)
    if tally.keep is not None and sum(tally.violations.values()) > before:
        tally.keep.mkdir(parents=True, exist_ok=True)
        shutil.copy(recorded, tally.keep / f"{tally.seed}-{tally.daemons}.mcap")


def _judge(tally: Tally, wires: Wires, recorded: Path, thrown: Sequence[Injected]) -> None:
    tally.check("outputs of the boards", [message for probe in wires.channels for message in probe.wrong])
    session = Session(recorded)
    records, events = list(session.ticks()), list(session.events())
    configs = build_robot_configs(wires.loaded, RATE_HZ)
    commands = {
        axis: [record.robots[index].axes[place].device for record in records]
        for index, config in enumerate(configs)
        for place, axis in enumerate(config.axes)
    }
    seen_there = [w for e in wires.servos for w in (*e.wrong, *e.foreign(commands[e.axis]))]
    tally.check("goals at the servos", seen_there)
    machine = SimpleNamespace(configs=configs, loaded=wires.loaded)
    seen: Any = SimpleNamespace(case=SimpleNamespace(machine=machine), records=records, events=events)
    tally.check("position limits", list(motion_invariants.position(seen)))
    tally.check("velocity and acceleration limits", list(motion_invariants.rates(seen)))
    tally.check(
        "session complete", [*([] if session.end.clean else [session.end.cut]), *invariants.complete(seen)]
    )
    tally.check("no jump on arming", list(_no_jump(configs, records)))
    by_tick = {record.tick: record.deadline_s for record in records}
    tally.check(
        "session check",
        [
            str(broken)
            for broken in check_session(session)
            # What a body does of which a device is broken is no mistake of the run.
            if broken.rule != "follow" or not _thrown_at(broken.robot, by_tick[broken.tick], thrown, 0.5)
        ],
    )
    faults = [(by_tick.get(e.tick, 0.0), e.robot, e.message) for e in events if isinstance(e, FaultLatched)]
    tally.check("other robots unaffected", list(_unaffected(faults, thrown)))
    tally.check("estop within the tick", list(_estops(configs, records, events)))
    for injected in thrown:
        _detected(tally, injected, records, configs, TIMEOUT_S if len(wires.buses) == 1 else 0.0)


def _thrown_at(robot: str, at_s: float, thrown: Sequence[Injected], late_s: float) -> bool:
    """Whether a switch on a bus of the robot was on, or had been until ``late_s`` ago."""
    return any(robot in i.robots and i.at_s - 0.05 <= at_s <= i.latest_s + late_s for i in thrown)


def _unaffected(faults: list[tuple[float, str, str]], thrown: Sequence[Injected]) -> Iterator[str]:
    """Every fault has a switch on its own bus that was on, or had just been."""
    for at_s, robot, message in faults:
        # A device may latch what ails it between two looks, and refuse to be armed much later.
        late_s = math.inf if "arm-refused" in message else 0.5
        if not _thrown_at(robot, at_s, thrown, late_s):
            yield f"{robot}: {message}"


def _detected(
    tally: Tally, injected: Injected, records: list[TickRecord], configs: Any, exchange_s: float
) -> None:
    """A watched robot of a bus in trouble is in FAULT within the stated ticks.

    A bus alone has no thread of its own: its exchanges, of ``exchange_s`` at least, make the ticks longer.
    """
    if not injected.switch.must:
        return
    # A bus takes its time-outs to answer, and the machine some ticks to be on time.
    allowed_s = (injected.switch.ticks + 2) * max(1.0 / RATE_HZ, exchange_s) + 0.1
    end_s = min(injected.until_s, injected.order_s)
    found: list[str] = []
    if end_s - injected.at_s > allowed_s:
        watched = [r for r in records if injected.at_s - 0.5 / RATE_HZ <= r.deadline_s <= end_s]
        first = {}
        for index, config in enumerate(configs):
            if config.name not in injected.concerned or not watched:
                continue
            modes = [Mode(record.robots[index].mode) for record in watched]
            if modes[0] in (Mode.APPROACH, Mode.RUN, Mode.HOLD) and Mode.FAULT in modes:
                first[config.name] = watched[modes.index(Mode.FAULT)].deadline_s - injected.at_s
            elif modes[0] in (Mode.APPROACH, Mode.RUN, Mode.HOLD):
                first[config.name] = float("inf")
        if first:
            took_s = max(first.values())
            if took_s > allowed_s:
                found.append(f"{injected.bus} {injected.switch.name} in {injected.state}: {first}")
            else:
                tally.time(f"FAULT after {injected.switch.name}", took_s)
    tally.check("fault within the stated ticks", found)


def _no_jump(configs: Any, records: list[TickRecord]) -> Iterator[str]:
    """The first command after arming is what was measured."""
    for index, config in enumerate(configs):
        armed = False
        for old, new in pairwise(records):
            was, now = old.robots[index], new.robots[index]
            commanded = now.axes[0].device == now.axes[0].device
            if commanded and not armed:
                armed = True
                for a, b in zip(now.axes, was.axes, strict=True):
                    # Pressures are noisy by some hundred Pa. A shaft that still turns goes on between the
                    # reading and the arming.
                    room = 3000.0 if config.name in PRESSURES else 0.02 + 2.0 / RATE_HZ * abs(b.velocity)
                    if not abs(a.device - b.value) <= room:
                        yield f"{config.name}: begins at {a.device}, measured {b.value}, tick {new.tick}"
                        return
            if not now.flags & ENABLED:
                armed = False


def _estops(configs: Any, records: list[TickRecord], events: list[Any]) -> Iterator[str]:
    """In the tick of an estop no robot is commanded any more: OFF, or a fault that was latched already."""
    by_tick = {record.tick: record for record in records}
    for event in events:
        if not isinstance(event, OrderGiven) or event.order["order"] != "estop" or event.tick not in by_tick:
            continue
        for config, robot in zip(configs, by_tick[event.tick].robots, strict=True):
            commanded = any(axis.device == axis.device for axis in robot.axes)
            if robot.mode not in (Mode.OFF, Mode.FAULT) or commanded or robot.flags & ENABLED:
                yield f"{config.name}: {Mode(robot.mode).name} in the tick of an estop, {event.tick}"
