"""The end of a keeper: its bus process has time to bring devices to rest, however the end comes."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from contid.control.process.isolation import keeper, served_process
from contid.control.process.isolation.bus_process import BusProcess

RESTS_S = 0.15


@pytest.mark.process
@pytest.mark.parametrize("signals", [0, 1, 5])
def test_the_bus_process_rests_its_devices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signals: int
) -> None:
    """The socket ends first, then comes the signal that a dying control process leaves behind."""
    ready, done = tmp_path / "ready", tmp_path / "done"

    def rest_at_the_end(served: object, connection: int, output: int, body: bytes) -> int:
        with socket.socket(fileno=os.dup(connection)) as theirs:
            ready.touch()
            theirs.recv(1)
        time.sleep(RESTS_S)
        done.touch()
        return 0

    monkeypatch.setattr(served_process, "main", rest_at_the_end)
    monkeypatch.setattr(keeper, "REST_S", 60.0)  # a busy machine lets it wait for a processor
    pid, orders = keeper.start("contid.bus.test", BusProcess, b"")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    socket.send_fds(orders, [keeper.OPEN], [theirs.fileno()])
    theirs.close()
    assert arrives(ready.exists)
    ours.close()
    orders.close()
    for _ in range(signals):
        time.sleep(0.2 * RESTS_S / max(signals, 1))
        os.kill(pid, signal.SIGTERM)
    os.waitpid(pid, 0)
    assert done.exists()


@pytest.mark.process
def test_a_bus_process_that_has_ended_keeps_its_number_until_its_group_was_killed() -> None:
    """The number of one that was waited for may be that of others."""
    pid = os.fork()
    if not pid:
        os.setpgid(0, 0)
        os._exit(7)
    assert arrives(lambda: keeper.ended_child(os.P_PID, pid) == pid)
    assert keeper.ended_child(os.P_PID, pid) == pid
    os.killpg(pid, signal.SIGKILL)  # raises when there is no such group
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 7


def arrives(is_there: Callable[[], bool]) -> bool:
    end_s = time.monotonic() + 60.0
    while not is_there() and time.monotonic() < end_s:
        time.sleep(0.005)
    return is_there()
