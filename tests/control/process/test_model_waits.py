"""Questions of a model outside ticks: they wait for a process that others keep from its processor."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.model_port import ModelLostError, ModelPort
from contid.control.process.isolation.model_ports import model_ports
from contid.robot_file.load import parse_robot_file
from tests.support.broken.bad_model import ROBOT, installed_in
from tests.support.fingers import fingers

pytestmark = [pytest.mark.process, pytest.mark.realtime]

HERE = (0.05, 0.05)
LONGEST_S = 0.1


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    return tmp_path


def built(folder: Path, how: str) -> ModelPort:
    text = fingers(1, buses=2) + ROBOT.format(name="f1", how=how, trigger=folder / "trigger", bus="bus1")
    (port,) = model_ports(isolated(parse_robot_file(text, "fingers.yaml")))
    try:
        port.finish_building()
        while not port._link.pid:  # until its keeper has reported it; 0 would be this process
            port.tend()
            time.sleep(0.01)
    except ModelLostError:
        port.close()
        raise
    return port


@pytest.fixture
def waiting(folder: Path) -> Iterator[ModelPort]:
    """A model that computes 20 ms, in a process that gets next to nothing of a processor."""
    port = built(folder, "slow in a loop")
    processor = min(os.sched_getaffinity(0))
    other = os.fork()
    if not other:
        os.sched_setaffinity(0, {processor})
        while True:
            pass
    os.sched_setaffinity(port._link.pid, {processor})
    os.sched_setscheduler(port._link.pid, os.SCHED_IDLE, os.sched_param(0))
    share = Path(f"/proc/{port._link.pid}/autogroup")
    if share.exists():  # each session has a part of its own of a processor, whatever its processes are
        share.write_text("19")
    (folder / "trigger").touch()
    time.sleep(0.06)  # the model looks at it every 50 ms
    port.longest_s = LONGEST_S
    try:
        yield port
    finally:
        os.kill(other, signal.SIGKILL)
        os.waitpid(other, 0)
        port.close()


def test_a_check_in_a_thread_waits_as_long_as_others_compute(waiting: ModelPort) -> None:
    waited: list[float] = []

    def ask() -> None:
        began_s = time.monotonic()
        with suppress(ModelLostError):  # it may get enough of a processor at last
            waiting.ask(False, "forward", HERE)
        waited.append(time.monotonic() - began_s)

    check = threading.Thread(target=ask)
    check.start()
    time.sleep(0.5)
    check.join()
    assert waited[0] > 4.0 * LONGEST_S


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
