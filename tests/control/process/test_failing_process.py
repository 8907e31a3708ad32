"""What becomes of the buses when one does not open or has a defect, and after an internal error in a tick."""

from __future__ import annotations

import signal
import time
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.control.engine.tick_costs import TickCosts
from contid.control.process import control_process
from contid.control.process.isolation.port import IsolatedPort
from contid.control.process.other_devices import other_devices
from contid.control.process.tick_alarm import ProcessorWait, TickAlarm
from contid.errors import DriverDefectError


class Isolated:
    """A bus in a process of its own whose driver is broken."""

    closed = False

    def begin_opening(self) -> None:
        """It begins."""

    def finish_opening(self) -> None:
        raise DriverDefectError("bus servos: driver 'bad': no idea")

    def close(self, timeout_s: float) -> None:
        self.closed = True


def test_a_bus_in_this_process_is_closed_when_an_isolated_one_does_not_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed: list[str] = []
    bus = SimpleNamespace(name="board", axes=(), close=lambda: closed.append("board"))
    monkeypatch.setattr(control_process, "open_buses", lambda *_: {"board": bus})
    events: list[Any] = []
    isolated = Isolated()
    none = cast(Any, None)
    code = control_process._serve(
        cast(Any, SimpleNamespace(loaded=None)), none, cast(Any, SimpleNamespace(parent_gone=False)),
        cast(Any, SimpleNamespace(event=events.append)), none, {"servos": cast(IsolatedPort, isolated)},
    )  # fmt: skip
    assert code == events[0].exit_code != 0
    assert isolated.closed
    assert closed == ["board"]


@pytest.mark.parametrize("error", [ValueError("no idea"), SystemExit(0)])
def test_a_defect_of_a_driver_that_names_its_devices_is_an_error_of_its_bus(error: BaseException) -> None:
    class Bad:
        def wiring(self, *_: Any) -> dict[str, object]:
            return {}

        def devices(self, *_: Any) -> None:
            raise error

    wiring = SimpleNamespace(name="servos", driver="bad", options=None)
    bus = SimpleNamespace(driver=Bad(), wiring=wiring, axes=(SimpleNamespace(name="f.left"),))
    loaded = SimpleNamespace(file=SimpleNamespace(bringup={"f.left": None}))
    words = f"bus servos: driver 'bad': {type(error).__name__}: {error}"
    with pytest.raises(DriverDefectError, match=words):
        list(other_devices(cast(Any, loaded), cast(Any, bus)))


def test_no_alarm_of_the_tick_interrupts_what_follows_an_error_in_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The timer runs on, and devices come to rest for longer than a tick may last."""
    rested: list[bool] = []
    costs = TickCosts(time.monotonic, 1, [])

    class Broken:
        def __init__(self, *_: Any) -> None:
            self.engine = SimpleNamespace(costs=costs, exchange=SimpleNamespace(abandon=self.abandon))

        def run(self) -> None:
            TickAlarm(costs, ProcessorWait(), 200.0).install()
            costs.watch(True)
            costs.begin(0)
            raise RuntimeError("no idea")

        def abandon(self) -> None:
            end_s = time.thread_time() + 0.3  # the alarm leaves out the wait for a processor
            while time.thread_time() < end_s:
                pass
            rested.append(True)

    monkeypatch.setattr(control_process, "open_buses", lambda *_: {})
    monkeypatch.setattr(control_process, "request_real_time", lambda: "")
    monkeypatch.setattr(control_process, "disable_gc", lambda: None)
    monkeypatch.setattr(control_process, "ControlProcess", Broken)
    none, before = cast(Any, None), signal.getsignal(signal.SIGALRM)
    quiet = cast(Any, SimpleNamespace(event=lambda event: None, write=lambda ring: None, parent_gone=False))
    try:
        with pytest.raises(RuntimeError, match="no idea"):
            control_process._serve(cast(Any, SimpleNamespace(loaded=None)), none, quiet, quiet, quiet, {})
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert rested == [True]
