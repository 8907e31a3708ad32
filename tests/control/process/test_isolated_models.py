"""A model of others with any defect costs its own robot only: the records of the other are the same bits.

The tick is that of a real run, its time is not: both robots are in virtual time, and only answers of the bad
model have deadlines. `test_isolated_model_run` has a daemon in real time.
"""

from __future__ import annotations

import io
import os
import signal
import time
from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd, Timing, VirtualClock
from contid.control.engine.engine import Engine
from contid.control.engine.ports import BusPort
from contid.control.engine.tick_costs import UnansweredError
from contid.control.engine.wiring import build_robot_configs, open_buses
from contid.control.process.isolation import model_port
from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.model_port import ModelLostError
from contid.control.process.isolation.model_ports import model_ports
from contid.control.tick import fault_exits, transitions
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import parse_robot_file
from contid.trajectory.read import read_trajectory
from tests.support.broken.bad_model import KINDS, ROBOT, installed_in
from tests.support.fingers import Collector, circle_csv, fingers

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.realtime]

RATE_HZ = 200.0
#: The model is bad from this tick on; both robots are on their circle then.
BAD_FROM, TICKS = 120, 180
#: Longest tick: an answer may take `share_of` a period; the rest is what a loaded machine takes for others.
LONGEST_S = 2.0

ENDED, SLOW, RAISED = Fault.MODEL_ENDED, Fault.MODEL_TOO_SLOW, Fault.INTERNAL
LATE = "its model did not answer within 4.5 ms"
#: Fault of the bad robot and words of its message; none for what is no defect of the model.
FOUND: dict[str, tuple[Fault, str] | None] = {
    "sound": None,
    "raise": (RAISED, "ValueError: no idea"),
    "raise lost": (RAISED, "DeviceLostError: box: it is gone"),
    "raise of its own": (RAISED, "Strange: very"),
    "interrupt": (RAISED, "KeyboardInterrupt"),
    "recursion": (RAISED, "RecursionError"),
    "sys.exit": (RAISED, "SystemExit: enough"),
    "exit 0": (ENDED, "the process of its model exited with status 0"),
    "exit in C": (ENDED, "exited with status 0"),
    "another program": (ENDED, "exited with status 0"),
    "segfault": (ENDED, "the process of its model was ended by SIGSEGV"),
    "abort": (ENDED, "was ended by SIGABRT"),
    "SIGKILL": (ENDED, "was ended by SIGKILL"),
    "SIGTERM": (ENDED, "was ended by SIGTERM"),
    "SIGSTOP": (SLOW, LATE),
    "keeper killed": (ENDED, "has lost its keeper"),
    "descriptors closed": (ENDED, "exited with status 1"),
    "hang": (SLOW, LATE),
    "hang in a loop": (SLOW, LATE),
    "hang with the GIL": (SLOW, LATE),
    "slow": (SLOW, LATE),
    "slow in a loop": (SLOW, LATE),
    "slow with the GIL": (SLOW, LATE),
    "computes for long": (SLOW, LATE),
    "flood of stdout": (SLOW, LATE),
    "flood of stderr": (SLOW, LATE),
    "flood of logs": (SLOW, LATE),
    "None": (RAISED, "the model answered None, not a solution"),
    "text": (RAISED, "the model answered 'up', not a solution"),
    "a class of its own": (RAISED, "Guess object"),
    "NaN": (Fault.NOT_A_NUMBER, "nan"),
    "too few axes": (RAISED, "(0.05,) for 2 axes"),
    "no axes": (RAISED, "() for 2 axes"),
    "a number as axes": (RAISED, "TypeError"),
    "text as an axis": (RAISED, "left"),
    "None as residual": (RAISED, "None"),
    "a set as limits": (RAISED, "left"),
    "a long note": (RAISED, "the model answered 1000"),
    "build raises": (ENDED, "was ended by SIGABRT"),
    "build exits": (ENDED, "was ended by SIGABRT"),
    "build hangs": (ENDED, "was ended by SIGABRT"),
    # What they cost their own robot depends on the machine.
    "threads": None,
    "forks": None,
    "forks that compute": None,
    "a daemon": None,
    "two of it": None,
}
OWN_COST = ("threads", "forks", "forks that compute", "a daemon", "two of it")
#: Each of them is like one that CI tries.
SIMILAR = (
    "raise lost", "raise of its own", "interrupt", "recursion", "exit in C", "another program", "SIGKILL",
    "SIGTERM", "hang in a loop", "slow", "slow in a loop", "slow with the GIL", "forks", "forks that compute",
    "computes for long", "flood of stderr", "text", "no axes", "None as residual", "text as an axis",
    "build exits", "abort", "flood of stdout", "a daemon", "descriptors closed", "too few axes",
    "a number as axes", "sys.exit", "SIGSTOP", "threads", "two of it", "build raises",
)  # fmt: skip
TRIED = [
    pytest.param(kind, marks=[pytest.mark.campaign] if kind in SIMILAR else [], id=kind)
    for kind in KINDS
    if kind != "sound"
]


def share_of(how: str) -> float:
    """Periods that an answer may take: none but those of models that are to be too slow is found too slow.

    The keeper of a process that ends may be scheduled late, a note of 10 MB takes 20 ms and more, and an
    answer that is there when this process itself was late is taken.
    """
    found = FOUND[how]
    return 60.0 if found is not None and found[0] is not SLOW else 0.9


class BesideModel:
    """A finger, and a robot whose model has a process of its own, in virtual time."""

    def __init__(self, folder: Path, how: str) -> None:
        self.trigger = folder / "trigger"
        self._share = share_of(how)
        text = fingers(1, buses=2) + ROBOT.format(name="f1", how=how, trigger=self.trigger, bus="bus1")
        loaded = isolated(parse_robot_file(text, "fingers.yaml"))
        (self.model,) = model_ports(loaded)
        try:
            self.model.finish_building()
        except ModelLostError:
            self.model.close()
            raise
        self.clock = VirtualClock()
        self.collector = Collector(loaded)
        buses = {name: BusPort(bus, threaded=False) for name, bus in open_buses(loaded, self.clock).items()}
        self.engine = Engine(
            build_robot_configs(loaded, RATE_HZ), buses, RATE_HZ, self.collector, self.clock.now,
            trajectory=read_trajectory(io.StringIO(circle_csv(2, 5.0)), "circle.csv", loaded.driven),
            on_end=OnEnd.HOLD, attended=True,
        )  # fmt: skip
        self.model.begin_ticks(self.engine.costs, 400.0 / RATE_HZ)
        self.engine.arm()
        self.tick = 0
        self.longest_s = 0.0

    def spoil(self) -> None:
        """From now on the model is bad, and has its deadline."""
        self.trigger.touch()
        time.sleep(0.06)  # the model looks at it every 50 ms
        self.model.begin_ticks(self.engine.costs, self._share / RATE_HZ)

    def go(self, ticks: int) -> None:
        for _ in range(ticks):
            deadline_s = self.tick / RATE_HZ
            self.clock.set(deadline_s)
            began_s = time.monotonic()
            self.engine.cycle(Timing(self.tick, 0, deadline_s))
            if self.trigger.exists():
                self.longest_s = max(self.longest_s, time.monotonic() - began_s)
            self.tick += 1

    def tend(self, while_in: str) -> None:
        """Look at the process of the model as long as it is in a state."""
        until_s = time.monotonic() + 10.0
        assert self.model.state.name == while_in
        while self.model.state.name == while_in and time.monotonic() < until_s:
            self.model.tend()
            time.sleep(0.01)

    @property
    def good(self) -> list[str]:
        return [repr((record.tick, record.robots[0])) for record in self.collector.records]

    def faults(self) -> list[tuple[int, str]]:
        faults = [event for event in self.collector.events if event["event"] == "fault"]
        assert {event["robot"] for event in faults} <= {"f1"}
        return [(event["fault"], event["detail"]) for event in faults]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    return tmp_path


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The other robot beside a model without a defect."""
    folder = tmp_path_factory.mktemp("sound")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(installed_in(folder / "site"))
        run = BesideModel(folder, "sound")
        try:
            run.go(TICKS)
        finally:
            run.model.close()
    assert not run.faults()
    for robot in (0, 1):
        assert {record.robots[robot].mode for record in run.collector.records[BAD_FROM:]} == {Mode.RUN}
    return run.good


def test_every_kind_has_its_words() -> None:
    assert FOUND.keys() == set(KINDS)


@pytest.mark.parametrize("how", TRIED)
def test_a_defect_of_a_model_costs_its_robot_only(how: str, installed: Path, sound: list[str]) -> None:
    run = BesideModel(installed, how)
    try:
        run.go(BAD_FROM)
        run.spoil()
        run.go(TICKS - BAD_FROM)
    finally:
        began_s = time.monotonic()
        run.model.close()
    assert time.monotonic() - began_s < 3.0
    assert run.good == sound
    assert run.longest_s < LONGEST_S or how in OWN_COST
    if how in OWN_COST:
        return
    expected = FOUND[how]
    assert expected is not None
    ((fault, words),) = run.faults()
    assert fault == expected[0]
    assert expected[1] in words


def clear_and_resume(run: BesideModel) -> None:
    run.engine.robots.order(("f1",), fault_exits.ask_clear, run.tick / RATE_HZ)
    run.go(4)
    run.engine.robots.order(("f1",), transitions.resume, run.tick / RATE_HZ)


def test_a_model_that_ended_is_built_again(installed: Path) -> None:
    run = BesideModel(installed, "segfault")
    try:
        run.go(BAD_FROM)
        run.spoil()
        run.go(40)
        assert len(run.faults()) == 1
        run.trigger.unlink()
        for _ in range(50):
            time.sleep(0.1)
            clear_and_resume(run)
            run.go(60)
            if run.engine.robots.states[1].mode is Mode.RUN:
                break
    finally:
        run.model.close()
    assert run.engine.robots.states[1].mode is Mode.RUN


@pytest.mark.parametrize(
    ("how", "within_s", "words"),
    [
        ("build hangs", 0.3, "was not built within 0.3 s"),
        ("build exits", 30.0, "exited with status 0"),
        ("build raises", 30.0, "ValueError: no idea"),
    ],
)
def test_a_model_that_is_not_built_is_an_error_of_the_run(
    installed: Path, monkeypatch: pytest.MonkeyPatch, how: str, within_s: float, words: str
) -> None:
    (installed / "trigger").touch()
    monkeypatch.setattr(model_port, "BUILD_S", within_s)
    with pytest.raises(ModelLostError, match=f"robot f1: model 'bad': .*{words}"):
        BesideModel(installed, how)


def test_a_model_that_the_alarm_interrupts_is_built_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The alarm of a tick may come before the deadline of its question: the process would hang for ever."""
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    run = BesideModel(tmp_path, "sound")
    try:
        before = run.model._link.pid

        def alarmed(*_: object) -> bytes | None:
            run.engine.costs.running = -1
            raise UnansweredError("its model was interrupted after 100 ms")

        with monkeypatch.context() as patched:
            patched.setattr(run.model._timer, "wait", alarmed)
            with pytest.raises(UnansweredError):
                run.model.ask(False, "forward", (0.05, 0.05))
        run.tend(while_in="BUILDS")
        assert run.model.ask(False, "forward", (0.05, 0.05)).tip_m
        assert run.model._link.pid != before
        # One that ends between two questions is found and built again too.
        os.kill(run.model._link.pid, signal.SIGKILL)
        run.tend(while_in="READY")
        assert run.model.state.name == "BUILDS"
    finally:
        run.model.close()
