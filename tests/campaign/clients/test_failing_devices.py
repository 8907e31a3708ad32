"""Clients against a daemon whose devices fail: some seeds, and deliberate bugs that the checks must find."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.state import Effect, RobotState
from contid.remote.server.lease import Lease
from tests.campaign.clients.failing_devices import drawn, run
from tests.campaign.clients.seen_clients import checked
from tests.campaign.clients.virtual_time import found_in

SEEDS = int(os.environ.get("CONTID_CAMPAIGN_CASES", "1"))


@pytest.mark.parametrize("seed", range(1, SEEDS + 1))
def test_clients_of_failing_devices_in_virtual_time(seed: int) -> None:
    _, found = found_in(seed)
    assert found == []


def _keeps_torque(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    after: RobotState = transitions.stopped_at_once(config, state, now_s)  # type: ignore[attr-defined]
    return replace(after, pending=tuple(each for each in after.pending if each is not Effect.RELAX))


def _estop_that_keeps_torque(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(transitions, "stopped_at_once", transitions.estop, raising=False)
    patch.setattr(transitions, "estop", _keeps_torque)


def _stop_that_bars_no_client(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Lease, "_check_stopped", lambda self, client: None)


@pytest.mark.parametrize(
    ("bug", "finds"),
    [(_estop_that_keeps_torque, "rest: "), (_stop_that_bars_no_client, "answers: moved after a stop")],
)
def test_a_deliberate_bug_is_found(
    bug: Callable[[pytest.MonkeyPatch], None], finds: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bug(monkeypatch)
    _, found = found_in(6)
    assert any(each.startswith(finds) for each in found), found


@pytest.mark.campaign
@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("seed", range(1, SEEDS + 1))
def test_clients_of_failing_devices_on_a_real_daemon(seed: int) -> None:
    with tempfile.TemporaryDirectory(prefix="adv-") as folder:  # short: a path of a socket has 107 bytes
        case = drawn(seed, Path(folder))
        run(case)
        assert [*case.spoiled, *checked(case)] == []
