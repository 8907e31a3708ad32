"""Seconds of the soak of a fleet; `python -m benchmarks.fleet.soak` is an hour of it."""

from __future__ import annotations

import os

import pytest

from benchmarks.fleet import soak
from tests.support.fleet_faults import FAULTS

MINUTES = float(os.environ.get("CONTID_FLEET_SOAK_MINUTES", "0.1"))
#: The promise has 50 ms; here other programs run too, so only that a robot holds, and which faults hold it.
PROMISE_S = 8.0
HOLDING = ("client killed", "bridge killed", "link cut")


@pytest.mark.process
@pytest.mark.realtime
def test_some_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    code = soak.soak(MINUTES, promise_s=PROMISE_S, faults=HOLDING)
    printed = capfd.readouterr().out
    assert code == 0, printed
    assert "0 violations; grows: nothing" in printed


def test_the_promise_has_two_sides() -> None:
    never, at_once = FAULTS["link cut for 300 ms"], FAULTS["client killed"]
    infinite = float("inf")
    assert soak.kept(never, 1.0, infinite, 0.05)
    assert not soak.kept(never, 1.0, 0.4, 0.05)
    assert soak.kept(at_once, 1.0, 0.02, 0.05)
    assert not soak.kept(at_once, 1.0, 0.2, 0.05)
    assert not soak.kept(at_once, 1.0, infinite, 0.05)
