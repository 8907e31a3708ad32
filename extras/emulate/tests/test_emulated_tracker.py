"""What an emulated tracker hands to daemons that come and go."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, ClassVar

import pytest

from contid.client import Code, ConnectionLostError, NoDaemonError, RemoteError
from contid.hal import TipMeasured
from contid_emulate import tracking
from contid_emulate.tracking import DaemonTracker


class Daemon:
    """Stands for `contid.client.Client` and the daemon behind it."""

    there, refuses, lost = True, "", False
    tips: ClassVar[list[tuple[str, float]]] = []

    def __init__(self, socket: str | None, name: str) -> None:
        if not Daemon.there:
            raise NoDaemonError("no daemon runs")

    def status(self) -> None:
        pass

    def measure(self, tip_mm: Sequence[float], *, robot: str, time_s: float) -> None:
        self.track(tip_mm, time_s, robot=robot)

    def track(self, tip_mm: Sequence[float], time_s: float, *, robot: str) -> list[RemoteError]:
        if Daemon.lost:
            raise ConnectionLostError("the daemon closed the connection")
        Daemon.tips.append((robot, tip_mm[0]))
        return [RemoteError(Code.BAD_MEASUREMENT, f"{time_s:g} s old")] if Daemon.refuses else []

    def close(self) -> None:
        pass


@pytest.fixture
def daemon(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(tracking, "Client", Daemon)
    monkeypatch.setattr(tracking, "_AGAIN_S", 0.0)
    for name, value in (("there", True), ("refuses", ""), ("lost", False), ("tips", [])):
        monkeypatch.setattr(Daemon, name, value)
    return Daemon


def tip(robot: str, x_m: float, age_s: float = -1.0) -> TipMeasured:
    return TipMeasured(robot, (x_m, 0.0, 0.0), time.monotonic() - age_s)


def test_the_newest_tip_of_each_robot_goes_out(daemon: Any) -> None:
    tracker = DaemonTracker(None, pytest.fail)
    tracker.send([tip("a", 0.001), tip("b", 0.002), tip("a", 0.003)])
    assert sorted(daemon.tips) == [("a", 3.0), ("b", 2.0)]


def test_tips_from_before_the_connection_are_left_out(daemon: Any) -> None:
    DaemonTracker(None, pytest.fail).send([tip("a", 0.001, age_s=0.5)])
    assert daemon.tips == []


def test_a_daemon_that_comes_later_or_again_is_tracked(daemon: Any) -> None:
    tracker = DaemonTracker(None, pytest.fail)
    daemon.there = False
    tracker.send([tip("a", 0.001)])
    daemon.there = True
    tracker.send([tip("a", 0.002)])
    daemon.lost = True
    tracker.send([tip("a", 0.003)])
    daemon.lost = False
    tracker.send([tip("a", 0.004)])
    assert [x for _, x in daemon.tips] == [2.0, 4.0]


def test_a_refusal_is_named_once(daemon: Any) -> None:
    named: list[str] = []
    tracker = DaemonTracker(None, named.append)
    daemon.refuses = "old"
    for k in range(4):
        tracker.send([tip("a", 0.001 * k)])
    assert len(named) == 1
    assert named[0].endswith("s old")
