"""Buses are closed when another one does not open."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.control.process import control_process
from contid.control.process.isolation.port import IsolatedPort
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
        cast(Any, SimpleNamespace(loaded=None)), none, none, cast(Any, SimpleNamespace(event=events.append)),
        none, {"servos": cast(IsolatedPort, isolated)},
    )  # fmt: skip
    assert code == events[0].exit_code != 0
    assert isolated.closed
    assert closed == ["board"]
