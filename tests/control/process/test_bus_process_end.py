"""What a bus process does when the control process dies, and what the next bus process gets."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.control.engine.ports import BusJob
from contid.control.process.isolation import port as port_module
from contid.control.process.isolation.bus_process import BusProcess
from contid.control.process.isolation.link import ProcessState
from contid.control.process.isolation.port import IsolatedPort
from contid.control.process.isolation.served_process import MOST_SHARE
from contid.control.process.isolation.wire import HEAD, LONGEST, BusWire, KeptAnswer, RequestKind
from contid.control.tick.state import Effect
from contid.hal import Rest, Sample
from contid.hal.isolated import IsolatedBusOptions
from contid.robot_file.document import BusWiring

AXES = ("f.left", "g.left")
UNPRIVILEGED = 65534


class Servos:
    """A bus without a watchdog, which notes how its axes come to rest."""

    name, axes = "servos", AXES

    def __init__(self, control: socket.socket, dies: bool = False) -> None:
        self._control, self._dies = control, dies
        self.rested: dict[str, Rest] = {}
        self.closed = False

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        if self._dies:
            self._control.close()
        return dict.fromkeys(AXES, Sample(0.0, 0.0, True, 0.0))

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        self.rested |= dict.fromkeys(axes, rest)

    def answer_counts(self) -> Mapping[str, int]:
        raise ValueError("no idea")

    def close(self) -> None:
        self.closed = True


def bus_process(served: socket.socket, bus: Servos) -> BusProcess:
    process = BusProcess(served, b"")
    process._bus, process._wire = cast(Any, bus), BusWire(AXES)
    process._rests = dict.fromkeys(AXES, Rest.RELAX)
    process._hurried = True
    return process


@pytest.mark.parametrize("when", ["between jobs", "during a job", "before it takes the answer"])
def test_devices_rest_whenever_the_control_process_dies(when: str) -> None:
    control, served = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    bus = Servos(control, dies=when == "during a job")
    if when != "between jobs":
        control.send(HEAD.pack(RequestKind.JOB, 1) + BusWire(AXES).job(BusJob({})))
    process = bus_process(served, bus)
    if when == "before it takes the answer":
        served.send(b"an answer that is not taken")
    if when != "during a job":
        control.close()
    with served:
        process.serve()
    assert bus.rested == dict.fromkeys(AXES, Rest.RELAX)


def test_a_bus_that_cannot_count_is_closed_all_the_same() -> None:
    control, served = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    bus = Servos(control)
    with control, served:
        control.send(HEAD.pack(RequestKind.COUNTS, 1))
        control.send(HEAD.pack(RequestKind.CLOSE, 2))
        bus_process(served, bus).serve()
        assert json.loads(control.recv(LONGEST)[HEAD.size :]) == {}
    assert bus.closed
    assert not bus.rested


@pytest.mark.process
def test_a_user_without_rights_may_give_up_real_time_priority() -> None:
    """The oracle is the kernel: a flag of the scheduler that is set once stays set for such a user."""
    child = os.fork()
    if not child:
        code = 1
        try:
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            if os.geteuid() == 0:
                os.setuid(UNPRIVILEGED)
            process = BusProcess(cast(Any, None), b"")
            process._looked_s, process._ran_s = 1e-9, -1e9 * MOST_SHARE  # it has computed most of the time
            process._look()
            code = 0 if process._looked_s == 0.0 else 2
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


class Link:
    """The link to a bus process, which notes what is sent."""

    def __init__(self, name: str, served: object, body: bytes) -> None:
        self.sent: list[KeptAnswer] = []
        self.state = ProcessState.RUNS

    def start_process(self) -> None:
        self.state = ProcessState.RUNS

    def request(self, kind: RequestKind, body: bytes = b"") -> None:
        if self.state is ProcessState.RUNS:
            self.sent.append(KeptAnswer(kind, body))

    send_unanswered = request


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> IsolatedPort:
    monkeypatch.setattr(port_module, "KeptProcess", Link)
    options = IsolatedBusOptions(watchdog_ms=None, body=b"")
    wiring = SimpleNamespace(
        name="servos", driver="bad", tolerance_ticks=3, options=options,
        axes=tuple((axis, None) for axis in AXES),
    )  # fmt: skip
    return IsolatedPort(cast(BusWiring, wiring))


def sent(port: IsolatedPort) -> list[KeptAnswer]:
    return list(cast(Any, port._link).sent)


def test_after_an_error_every_robot_of_an_isolated_bus_comes_to_rest(port: IsolatedPort) -> None:
    """`contid.control.engine.exchange.Exchange.abandon` asks the buses of one robot after the other.

    The bus process may be at a job, and takes the next one after it.
    """
    port.start(BusJob({}))
    for axis in AXES:
        port.rest([axis], Rest.RELAX)
    jobs = [BusWire(AXES).job_of(body) for _, body in sent(port)]
    assert [job.effects for job in jobs] == [(), *(((0, Effect.RELAX, (axis,)),) for axis in AXES)]


def test_a_bus_process_that_is_started_anew_gets_the_limits_of_effort(port: IsolatedPort) -> None:
    port.limit_effort({"f.left": 0.25})
    cast(Any, port._link).state = ProcessState.ENDED
    port.limit_effort({"g.left": 0.5})
    cast(Any, port._link).sent.clear()
    port.start(BusJob({}, reopen=True))
    assert [kind for kind, _ in sent(port)] == [RequestKind.JOB, RequestKind.EFFORT]
    assert json.loads(sent(port)[1].body) == {"f.left": 0.25, "g.left": 0.5}
