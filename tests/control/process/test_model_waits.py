"""Questions of a model outside ticks: they wait for a process that others keep from its processor.

The process of the model is stopped, and what the kernel reports of it is replaced: that it waits for a
processor all the time. `test_process_time` has what the kernel reports of one that does wait.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest

from contid.control.process.isolation import model_port, timed_answer
from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.model_port import ModelLostError, ModelPort
from contid.control.process.isolation.model_ports import model_ports
from contid.control.process.isolation.wire import KeptAnswer, RequestKind
from contid.robot_file.load import parse_robot_file
from tests.support.broken.bad_model import ROBOT, installed_in
from tests.support.fingers import fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

HERE = (0.05, 0.05)
#: Long beside what a busy machine keeps this process itself waiting.
LONGEST_S, WAITS = 0.3, 8.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    return tmp_path


def built(folder: Path, how: str) -> ModelPort:
    text = fingers(1, buses=2) + ROBOT.format(name="f1", how=how, trigger=folder / "trigger", bus="bus1")
    (port,) = model_ports(isolated(parse_robot_file(text, "fingers.yaml")))

    def is_reported() -> bool:
        port.tend()
        return port._link.pid != 0

    try:
        port.finish_building()
        until(is_reported, "its keeper has reported it")
    except BaseException:
        port.close()
        raise
    return port


class WaitsAlways:
    """What `ProcessTime` reports of a process that gets nothing of a processor."""

    def __init__(self, pid: int) -> None:
        self.pid, self._last_s = pid, 0.0

    def close(self) -> None:
        """Nothing is open."""

    def begin(self) -> None:
        self._last_s = time.monotonic()

    def waited_s(self) -> float:
        before_s, self._last_s = self._last_s, time.monotonic()
        return self._last_s - before_s


@pytest.fixture
def waiting(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModelPort]:
    """A model whose process gets nothing of a processor."""
    monkeypatch.setattr(timed_answer, "ProcessTime", WaitsAlways)
    monkeypatch.setattr(model_port, "WAITS", WAITS)
    port = built(folder, "sound")
    try:
        os.kill(port._link.pid, signal.SIGSTOP)
        port.longest_s = LONGEST_S
        yield port
    finally:
        port.close()


def test_a_check_waits_as_long_as_others_compute(waiting: ModelPort) -> None:
    began_s = time.monotonic()
    with pytest.raises(ModelLostError):
        waiting.ask(False, "forward", HERE)
    assert time.monotonic() - began_s >= WAITS * LONGEST_S


def test_a_model_may_compute_for_long_before_the_first_tick(folder: Path) -> None:
    """Real-time priority, under which the kernel ends what computes for 0.5 s, begins with the ticks."""
    port = built(folder, "computes for long")
    try:
        (folder / "trigger").touch()
        time.sleep(0.06)
        before = port._link.pid
        assert port.ask(False, "forward", HERE).tip_m == (0.05, 0.05, 0.0)
        assert port._link.pid == before
    finally:
        port.close()


def test_a_model_that_stood_still_with_who_asks_it_is_not_too_slow(folder: Path) -> None:
    """As when the machine was suspended, in the first half of the time of an answer."""
    context = multiprocessing.get_context("fork")
    inside, outside = context.Pipe()

    def ask() -> None:
        port = built(folder, "sound")
        port.longest_s = 2.0
        os.kill(port._link.pid, signal.SIGSTOP)
        outside.send(port._link.pid)
        try:
            outside.send(str(port.ask(False, "forward", HERE).tip_m))
        except ModelLostError as error:
            outside.send(str(error))
        port.close()

    asker = context.Process(target=ask)
    asker.start()
    try:
        model = inside.recv()
        time.sleep(0.2)
        os.kill(asker.pid or 0, signal.SIGSTOP)
        time.sleep(2.5)
        os.kill(asker.pid or 0, signal.SIGCONT)
        time.sleep(1.2)  # 1.4 s of its 2 s
        os.kill(model, signal.SIGCONT)
        assert inside.recv() == "(0.05, 0.05, 0.0)"
    finally:
        asker.join(20.0)
        inside.close()
        outside.close()


class StandsStill:
    """A link whose process answers after ``needs_s`` of its own, on a clock that stands still once.

    From ``at_s`` on both processes stand still for ``for_s``.
    """

    state = ProcessState.RUNS
    pid = 0

    def __init__(self, needs_s: float, at_s: float, for_s: float) -> None:
        self.now_s = self.had_s = 0.0
        self._needs_s, self._at_s, self._for_s = needs_s, at_s, for_s

    def answer(self, timeout_s: float) -> KeptAnswer | None:
        step_s = min(timeout_s, self._needs_s - self.had_s)
        self.had_s += step_s
        if self.now_s <= self._at_s < self.now_s + step_s:  # the end of the wait is in the standstill
            self.had_s -= self.now_s + step_s - self._at_s
            self.now_s = self._at_s + self._for_s
            return None
        self.now_s += step_s
        return KeptAnswer(RequestKind.ASK, b"it") if self.had_s >= self._needs_s else None


@pytest.mark.parametrize("at_s", [0.0, 0.1, 0.3, 0.49, 0.5, 0.7, 0.86])
@pytest.mark.parametrize("for_s", [1.0, 100.0])
def test_a_standstill_of_who_asks_does_not_count_wherever_it_falls(
    at_s: float, for_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    for needs_s, answers in ((0.85, True), (1.3, False)):  # an eighth of the time may count
        link = StandsStill(needs_s, at_s, for_s)
        monkeypatch.setattr(time, "monotonic", lambda link=link: link.now_s)
        timer = timed_answer.AnswerTimer(cast("KeptProcess", link))
        assert (timer.wait(1.0, 20.0) == b"it") is answers
        timer.close()
