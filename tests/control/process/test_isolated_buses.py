"""A driver of others with any defect costs its own robot only: the records of the other are the same bits.

The tick is that of a real run, its time is not: the other robot is in virtual time, and only the bad bus has
deadlines. `test_isolated_run` has a daemon in real time.
"""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import pytest

from contid.control.engine.cycle import OnEnd, RealClock, Timing, VirtualClock
from contid.control.engine.engine import Engine
from contid.control.engine.ports import BusPort
from contid.control.engine.wiring import build_robot_configs, open_buses
from contid.control.process.isolation import bus_process
from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.port import IsolatedPort, isolated_ports
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.robot_file.document import Isolation
from contid.robot_file.load import parse_robot_file
from contid.trajectory.read import read_trajectory
from tests.support.bad_driver import KINDS, installed_in
from tests.support.fingers import Collector, circle_csv, fingers

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.realtime]

RATE_HZ = 200.0
#: The bus is bad from this tick on; the other robot is on its circle then.
BAD_FROM, TICKS = 120, 180
#: Longest tick: an answer may be late by `share_of` a period; the rest is what a loaded machine takes for
#: others (0.6 s were seen). A tick that waits for a bus that hangs never ends.
LONGEST_S = 2.0

ENDED, LOST, STALLED = Fault.DRIVER_ENDED, Fault.DEVICE_LOST, Fault.BUS_STALLED
#: Fault of the bad robot and words of its message; none for what is no defect of the bus.
FOUND: dict[str, tuple[Fault, str] | None] = {
    "sound": None,
    "raise": (LOST, "bus1: ValueError: no idea"),
    "raise lost": (LOST, "box: it is gone"),
    "raise of its own": (LOST, "bus1: Strange: very"),
    "interrupt": (LOST, "bus1: KeyboardInterrupt"),
    "recursion": (LOST, "bus1: RecursionError"),
    "sys.exit": (LOST, "bus1: SystemExit: enough"),
    "exit 0": (ENDED, "bus1: driver 'bad' exited with status 0"),
    "exit in C": (ENDED, "exited with status 0"),
    "another program": (ENDED, "exited with status 0"),
    "segfault": (ENDED, "was ended by SIGSEGV"),
    "abort": (ENDED, "was ended by SIGABRT"),
    "SIGKILL": (ENDED, "was ended by SIGKILL"),
    "SIGTERM": (ENDED, "was ended by SIGTERM"),
    "SIGSTOP": (STALLED, "no answer for 3 ticks"),
    "keeper killed": (ENDED, "has lost its keeper"),
    "descriptors closed": (ENDED, "exited with status 1"),
    "hang": (STALLED, "no answer for 3 ticks"),
    "hang in a loop": (STALLED, "no answer for 3 ticks"),
    "hang with the GIL": (STALLED, "no answer for 3 ticks"),
    "slow": (STALLED, "no answer for 3 ticks"),
    "slow in a loop": (STALLED, "no answer for 3 ticks"),
    "slow with the GIL": (STALLED, "no answer for 3 ticks"),
    "flood of stdout": (STALLED, "no answer for 3 ticks"),
    "flood of stderr": (STALLED, "no answer for 3 ticks"),
    "flood of logs": (STALLED, "no answer for 3 ticks"),
    "text": (LOST, "the driver answered 'fine' (str)"),
    "None": (LOST, "the driver answered 'None'"),
    "NaN": (Fault.IMPLAUSIBLE_SAMPLE, "not with a finite number"),
    "text as values": (Fault.DEVICE_FAULT, "far"),
    "no samples": (Fault.AXIS_SILENT, "did not answer 3 times"),
    "other axes": (Fault.AXIS_SILENT, "did not answer 3 times"),
    "open hangs": (LOST, "bus1: it is gone"),
    "open exits": (LOST, "bus1: it is gone"),
    "close hangs": None,
    "disable hangs": None,
    # What they cost their own bus depends on the machine.
    "threads": None,
    "forks": None,
    "forks that compute": None,
    "a daemon": None,
    "two of it": None,
    "a long fault": None,
}
OWN_COST = (
    "threads", "forks", "forks that compute", "a daemon", "two of it", "a long fault", "slow in a loop",
)  # fmt: skip
#: Each of them is like one that CI tries.
SIMILAR = (
    "raise lost", "interrupt", "recursion", "exit in C", "another program", "SIGKILL", "SIGTERM",
    "hang in a loop", "slow in a loop", "slow with the GIL", "forks", "forks that compute",
    "flood of stderr", "None", "text as values", "no samples", "other axes", "open exits", "disable hangs",
    "abort", "flood of stdout", "a daemon", "descriptors closed",
    "raise of its own", "sys.exit", "SIGSTOP", "text", "threads", "two of it",
)  # fmt: skip
TRIED = [
    pytest.param(kind, marks=[pytest.mark.campaign] if kind in SIMILAR else [], id=kind)
    for kind in KINDS
    if kind != "sound"
]


def share_of(how: str) -> float:
    """Share of a period that the bad bus has; the keeper of one that ends may be scheduled late."""
    found = FOUND[how]
    return 60.0 if found is not None and found[0] is ENDED else 0.9


class Shifted(RealClock):
    """The clock of the bad bus: real, and always behind the virtual one, which begins at 0."""

    def __init__(self) -> None:
        self._origin_s = time.monotonic() + 60.0

    def now(self) -> float:
        return super().now() - self._origin_s


class Run:
    """A finger on a simulated bus in virtual time, and one on a bad bus in a process of its own."""

    def __init__(self, folder: Path, how: str) -> None:
        self.trigger = folder / "trigger"
        self.share = share_of(how)
        # A loaded machine may let the bus wait for longer than the watchdog that is usual.
        options = f"driver: bad\n    watchdog_ms: 10000\n    how: {how}\n    trigger: {self.trigger}"
        text = fingers(2, buses=2).replace("  bus1:\n    driver: sim", f"  bus1:\n    {options}")
        loaded = isolated(parse_robot_file(text, "fingers.yaml"))
        self.clock = VirtualClock()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(bus_process, "RealClock", Shifted)
            self.bad: IsolatedPort = isolated_ports(loaded.buses)["bus1"]
        self.bad.begin_opening()
        (sim,) = open_buses(loaded, self.clock).values()
        try:
            self.bad.finish_opening()
        except ContidError:
            self.bad.close(0.5)
            raise
        self.collector = Collector(loaded)
        ports = {"bus1": self.bad, "bus0": BusPort(sim, threaded=False)}
        self.engine = Engine(
            build_robot_configs(loaded, RATE_HZ), ports, RATE_HZ, self.collector, self.clock.now,
            trajectory=read_trajectory(io.StringIO(circle_csv(1, 5.0)), "circle.csv", loaded.driven),
            on_end=OnEnd.HOLD, attended=True,
        )  # fmt: skip
        self.engine.arm()
        self.tick = 0
        self.longest_s = 0.0

    def go(self, ticks: int) -> None:
        for _ in range(ticks):
            deadline_s = self.tick / RATE_HZ
            self.clock.set(deadline_s)
            began_s = time.monotonic()
            # The sound bus has any time that a loaded machine may need.
            share = self.share if self.trigger.exists() else 400.0
            self.engine.cycle(Timing(self.tick, 0, deadline_s, 0.0, deadline_s + share / RATE_HZ))
            if self.trigger.exists():
                self.longest_s = max(self.longest_s, time.monotonic() - began_s)
            self.tick += 1

    @property
    def good(self) -> list[str]:
        return [repr((record.tick, record.robots[0])) for record in self.collector.records]

    def fault(self) -> tuple[int, str] | None:
        faults = [event for event in self.collector.events if event["event"] == "fault"]
        assert {event["robot"] for event in faults} <= {"f1"}
        return (faults[0]["fault"], faults[0]["detail"]) if faults else None


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    return tmp_path


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The other robot beside a driver without a defect."""
    folder = tmp_path_factory.mktemp("sound")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(installed_in(folder / "site"))
        run = Run(folder, "sound")
        try:
            run.go(TICKS)
        finally:
            run.bad.close(0.5)
    assert run.fault() is None
    assert {record.robots[0].mode for record in run.collector.records[BAD_FROM:]} == {Mode.RUN}
    return run.good


def test_every_kind_has_its_words() -> None:
    assert FOUND.keys() == set(KINDS)


@pytest.mark.parametrize("how", TRIED)
def test_a_defect_of_a_driver_costs_its_robot_only(how: str, installed: Path, sound: list[str]) -> None:
    run = Run(installed, how)
    try:
        run.go(BAD_FROM)
        run.trigger.touch()
        time.sleep(0.06)  # the driver looks at it every 50 ms
        run.go(TICKS - BAD_FROM)
    finally:
        began_s = time.monotonic()
        run.bad.close(0.5)
    assert time.monotonic() - began_s < 3.0
    assert run.good == sound
    assert run.longest_s < LONGEST_S or how in OWN_COST
    fault = run.fault()
    if how in OWN_COST:
        return
    expected = FOUND[how]
    if expected is None or fault is None:
        assert fault == expected
    else:
        assert fault[0] == expected[0]
        assert expected[1] in fault[1]


def wait_for(run: Run, event: str, words: str) -> dict[str, Any]:
    for _ in range(400):
        run.go(1)
        time.sleep(1.0 / RATE_HZ)
        for each in run.collector.events:
            if each["event"] == event and words in (each.get("lost") or each.get("message") or ""):
                return each
    raise AssertionError(run.collector.events)


def test_a_process_that_ended_is_started_again(installed: Path) -> None:
    run = Run(installed, "hang")
    try:
        run.go(20)
        run.trigger.touch()
        wait_for(run, "answer", "did not answer for 0.5 s; its process was ended")
        run.trigger.unlink()
        wait_for(run, "bus", "bus1 is back")
    finally:
        run.bad.close(0.5)


def test_an_opening_that_hangs_or_crashes_is_an_error_of_the_run(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (installed / "trigger").touch()
    for how, within_s, words in (
        ("open hangs", 0.3, "did not open the bus within 0.3 s"),
        ("open exits", 30.0, "exited with status 0"),
    ):
        monkeypatch.setattr("contid.control.process.isolation.port.OPEN_S", within_s)
        with pytest.raises(ContidError, match=f"bus bus1: driver 'bad' {words}"):
            Run(installed, how)


def test_drivers_of_others_are_isolated_unless_the_file_has_it_otherwise(installed: Path) -> None:
    text = fingers(2, buses=2).replace(
        "  bus1:\n    driver: sim", "  bus1:\n    driver: bad\n    how: x\n    trigger: y"
    )
    assert {name: bus.isolation for name, bus in parse_robot_file(text, "f.yaml").buses.items()} == {
        "bus0": Isolation.THREAD, "bus1": Isolation.PROCESS,
    }  # fmt: skip
    swapped = text.replace("driver: bad", "driver: bad\n    isolation: thread")
    swapped = swapped.replace("driver: sim", "driver: sim\n    isolation: process")
    assert {name: bus.isolation for name, bus in parse_robot_file(swapped, "f.yaml").buses.items()} == {
        "bus0": Isolation.PROCESS, "bus1": Isolation.THREAD,
    }  # fmt: skip
