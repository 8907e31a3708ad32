"""The daemon as a service: its notifications to systemd, and that a restart never arms."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.control.daemon.notify import Notifier
from contid.control.engine import messages as msg
from contid.control.engine.tick_layout import ENABLED, TickRecord
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.supervisor import Mode
from tests.support.fingers import Collector, load

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]


@contextmanager
def manager(address: str) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind("\0" + address[1:] if address.startswith("@") else address)
        end.settimeout(30.0)
        yield end


def received(end: socket.socket) -> list[str]:
    end.setblocking(False)
    out = []
    with suppress(BlockingIOError):
        while True:
            out.append(end.recv(4096).decode())
    return out


@pytest.mark.realtime
@pytest.mark.parametrize("abstract", [False, True])
def test_ready_once_then_alive_by_ticks_only(tmp_path: Path, abstract: bool) -> None:
    address = f"@contid-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with manager(address) as end:
        notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2000000"})
        notifier.ticked(0, 100.0)
        assert received(end) == []
        notifier.ticked(1, 100.1)
        assert received(end) == ["READY=1", "WATCHDOG=1"]
        notifier.ticked(50, 100.2)
        assert received(end) == []  # not yet due
        notifier.ticked(150, 100.7)
        assert received(end) == ["WATCHDOG=1"]
        for seconds in range(200, 300):
            notifier.ticked(150, float(seconds))
        assert received(end) == []  # time alone is no sign of life
        notifier.stopping()
        notifier.stopping()
        assert received(end) == ["STOPPING=1"]


def test_a_watchdog_of_another_process_is_not_fed(tmp_path: Path) -> None:
    address = str(tmp_path / "notify")
    with manager(address) as end:
        environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}
        Notifier(environment, pid=2).ticked(5, 100.0)
        assert received(end) == ["READY=1"]


@pytest.mark.parametrize(
    ("environment", "tried"),
    [
        ({}, []),
        ({"WATCHDOG_USEC": "2000000"}, []),
        # A manager that is gone, and a time-out that is no number: each state is tried once.
        ({"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "soon"}, [b"READY=1", b"STOPPING=1"]),
    ],
)
def test_without_a_manager_nothing_is_sent(
    environment: dict[str, str], tried: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = []

    class Watched(socket.socket):
        def sendto(self, data: bytes, *rest: Any) -> int:  # type: ignore[override]
            sent.append(data)
            return super().sendto(data, *rest)

    monkeypatch.setattr(socket, "socket", Watched)
    notifier = Notifier(environment)
    for tick in (1, 2):
        notifier.ticked(tick, 100.0 * tick)
    notifier.stopping()
    assert sent == tried


@pytest.mark.realtime
def test_a_disarmed_robot_waits_for_resume_without_torque() -> None:
    seen = Collector(load(1))
    process = VirtualProcess(load(1), 200.0, seen, attended=True)
    process.engine.connect()
    for order in (None, msg.Resume()):
        if order is not None:
            process.engine.obey(order, process.tick)
        for _ in range(50):
            process.begin()
            process.turn()
    process.close()
    records = [r.robots[0] for r in seen.records if isinstance(r, TickRecord)]
    assert {Mode(r.mode) for r in records[1:50]} == {Mode.READY}
    assert not any(r.flags & ENABLED for r in records[:50])
    assert records[-1].mode == Mode.HOLD


@pytest.mark.realtime
def test_a_stopped_control_process_is_not_reported_alive(tmp_path: Path) -> None:
    """The real daemon: ready, alive, silent while its ticks stand still, alive again, stopping."""
    address = str(tmp_path / "notify")
    with manager(address) as end:
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", "finger", "--mock", "--disarmed"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "drivers"))),
                "NOTIFY_SOCKET": address,
                "WATCHDOG_USEC": "200000",
            },
        )
        try:
            assert end.recv(4096) == b"READY=1"
            for _ in range(3):
                assert end.recv(4096) == b"WATCHDOG=1"
            family = psutil.Process(process.pid).children()
            (child,) = [each for each in family if "contid.control.process" in each.cmdline()]
            child.send_signal(signal.SIGSTOP)
            # Ticks completed before may still be reported once or twice; then the daemon ends the run, and
            # the manager starts the next one.
            out, _ = process.communicate(timeout=20)
            assert process.returncode == 3
            assert b"finger" in out
        finally:
            process.kill()
            process.communicate()
