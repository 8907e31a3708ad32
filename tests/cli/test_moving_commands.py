"""Commands that move axes by themselves are not kept from their devices by other programs."""

from __future__ import annotations

import os

import pytest

from contid_devices.homing.moving_commands import interruptible
from tests.support.rights import real_time_permitted


@pytest.mark.skipif(not real_time_permitted(), reason="needs real-time priority")
def test_a_search_runs_under_real_time_priority_and_gives_it_back() -> None:
    before = os.sched_getscheduler(0)
    with interruptible():
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
    assert os.sched_getscheduler(0) == before


def test_without_the_right_to_real_time_a_search_runs_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    before = os.sched_getscheduler(0)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with interruptible():
        assert os.sched_getscheduler(0) == before
