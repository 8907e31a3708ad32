"""Questions of a model outside ticks: they wait for a process that others keep from its processor.

The process of the model is stopped, and what the kernel reports of it is replaced: that it waits for a
processor all the time. `test_process_time` has what the kernel reports of one that does wait.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from contid.control.process.isolation import model_port, timed_answer
from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.model_port import ModelLostError, ModelPort
from contid.control.process.isolation.model_ports import model_ports
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
