"""A driver that has ended is no stall, also when the report of its keeper is late."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator

import pytest

from contid.control.engine.ports import BusJob
from contid.control.process.isolation import keeper, port
from contid.control.process.isolation.body import isolated
from contid.control.tick.faults import Fault
from contid.robot_file.load import parse_robot_file
from tests.support.fingers import fingers

pytestmark = pytest.mark.process

TOLERANCE = 3


@pytest.fixture
def theirs(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The end of a keeper that does what the test does."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    monkeypatch.setattr(
        keeper, "start", lambda logger, served, body: (os.posix_spawn("/bin/true", ["true"], {}), ours)
    )
    monkeypatch.setattr(port, "HANGS_S", 1e6)
    with theirs:
        yield theirs


@pytest.fixture
def bus(theirs: socket.socket) -> Iterator[port.IsolatedPort]:
    """A port whose bus process runs, with a job under way."""
    text = fingers(1, tolerance=TOLERANCE).replace("driver: sim", "driver: sim\n    isolation: process")
    (made,) = port.isolated_ports(isolated(parse_robot_file(text, "fingers.yaml")).buses).values()
    made.begin_opening()
    made.start(BusJob({}))
    yield made
    made.close(0.0)


def process_of(keeper_end: socket.socket) -> int:
    order, (descriptor,), _, _ = socket.recv_fds(keeper_end, 16, 1)
    assert order == keeper.OPEN
    return descriptor


def test_a_socket_that_closed_is_the_end_of_the_driver_and_its_reason_follows(
    theirs: socket.socket, bus: port.IsolatedPort
) -> None:
    os.close(process_of(theirs))
    assert [bus.take(0.001) for _ in range(TOLERANCE - 1)] == [None] * (TOLERANCE - 1)
    reply = bus.take(0.001)
    assert reply is not None
    assert (reply.fault, reply.lost) == (Fault.DRIVER_ENDED, "bus0: driver 'sim' has ended")
    bus.lose(reply.lost)
    assert bus.busy  # no process is started before the report, which would be taken as the end of that one
    assert bus.take(0.0) is None
    theirs.send(json.dumps({"ended": "was ended by SIGSEGV"}).encode())
    reply = bus.take(0.0)
    assert reply is not None
    assert (reply.fault, reply.lost) == (Fault.DRIVER_ENDED, "bus0: driver 'sim' was ended by SIGSEGV")
    assert not bus.busy


def test_a_process_that_ends_is_no_stall_while_its_socket_is_still_open(
    theirs: socket.socket, bus: port.IsolatedPort
) -> None:
    """The kernel closes the socket last: after the memory, and after a core was written."""
    process = process_of(theirs)
    ended = os.posix_spawn("/bin/true", ["true"], {})
    os.waitid(os.P_PID, ended, os.WEXITED | os.WNOWAIT)
    theirs.send(json.dumps({"pid": ended}).encode())
    assert [bus.take(0.001) for _ in range(TOLERANCE - 1)] == [None] * (TOLERANCE - 1)
    reply = bus.take(0.001)
    assert reply is not None
    assert (reply.fault, reply.lost) == (Fault.DRIVER_ENDED, "bus0: driver 'sim' has ended")
    assert bus.busy
    os.waitpid(ended, 0)
    os.close(process)


def test_a_report_in_time_is_the_whole_message(theirs: socket.socket, bus: port.IsolatedPort) -> None:
    os.close(process_of(theirs))
    assert bus.take(0.001) is None
    theirs.send(json.dumps({"ended": "exited with status 0"}).encode())
    reply = bus.take(0.0)
    assert reply is not None
    assert (reply.fault, reply.lost) == (Fault.DRIVER_ENDED, "bus0: driver 'sim' exited with status 0")


def test_a_driver_that_is_only_slow_is_a_stall(theirs: socket.socket, bus: port.IsolatedPort) -> None:
    process = process_of(theirs)
    theirs.send(json.dumps({"pid": os.getpid()}).encode())
    assert [bus.take(0.001) for _ in range(2 * TOLERANCE)] == [None] * (2 * TOLERANCE)
    assert bus.stalls == 2 * TOLERANCE
    os.close(process)
