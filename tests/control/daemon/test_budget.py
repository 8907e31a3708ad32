"""The budget of a tick: measured, and a run that does not fit is refused with the rate that does."""

from __future__ import annotations

import io
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from contid.cli.commands.check import command
from contid.control.daemon.budget import Budget, TickCost
from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest
from contid.control.daemon.tick_times import check_budget, measure_budget
from contid.control.engine import engine
from contid.control.engine.cycle import Sink
from contid.control.tick import robot_tick
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile, load_named, parse_robot_file, with_mock
from tests.support.fingers import fingers

BURNT_S = 2e-3


def burn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every tick of every robot takes `BURNT_S` of the processor more."""

    def slow(*args: Any, **options: Any) -> Any:
        ends_s = time.thread_time() + BURNT_S
        while time.thread_time() < ends_s:
            pass
        return robot_tick.tick(*args, **options)

    monkeypatch.setattr(engine, "tick", slow)


def budget(rate_hz: float, robot_s: float, wire_s: float, own: bool) -> Budget:
    cost = TickCost("stream", {"arm": robot_s, "leg": 1e-4}, {"bus": 1e-3}, 2e-4)
    return Budget(rate_hz, {"bus": wire_s} if wire_s else {}, frozenset({"bus"} if own else ()), (cost,))


def test_the_rate_that_fits_leaves_a_fifth_beside_the_wire() -> None:
    assert budget(100.0, 7.7e-3, 0.0, own=False).highest_rate_hz == 100.0
    assert not budget(100.0, 7.6e-3, 0.0, own=False).refusal()
    refused = budget(100.0, 7.8e-3, 0.0, own=False)
    assert "81 % of the 10 ms at 100 Hz (robot arm: 7.8 ms)" in refused.refusal()
    assert "at most 98 Hz fit" in refused.refusal()
    # 8 ms of work beside 5 ms on the wire: a period of 15 ms.
    with_wire = budget(100.0, 7.7e-3, 5e-3, own=False)
    assert with_wire.highest_rate_hz == 66.0
    assert "beside 5 ms on the wire" in with_wire.refusal()
    # Simulated devices take the processor of the tick.
    assert budget(100.0, 7e-3, 0.0, own=True).refusal()
    assert not budget(100.0, 7e-3, 0.0, own=False).refusal()


@pytest.mark.parametrize(("rate_hz", "fits_hz", "named_hz"), [(33.5, 33.9, 33), (9.999, 9.9995, 9.99)])
def test_a_rate_between_those_that_are_named_fits(rate_hz: float, fits_hz: float, named_hz: float) -> None:
    found = Budget(rate_hz, {}, frozenset(), (TickCost("hold", {"arm": 0.8 / fits_hz}, {}, 0.0),))
    assert found.highest_rate_hz == named_hz
    assert found.refusal() == ""
    assert replace(found, rate_hz=fits_hz + 1e-3).refusal()


def test_a_tick_that_does_not_fit_is_found_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = with_mock(load_named("hand"))
    check_budget(loaded, loaded.file.rate_hz, "stream")
    burn(monkeypatch)
    found = measure_budget(loaded, 200.0, 0.05, 0.25, ("hold", "stream"))
    for cost in found.costs:
        assert all(BURNT_S <= took_s < 3.0 * BURNT_S for took_s in cost.robots_s.values())
    with pytest.raises(ContidError, match=r"hand.yaml: a tick takes .* at most \d+ Hz fit"):
        check_budget(loaded, 200.0, "path")


def test_a_run_that_does_not_fit_is_refused_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    burn(monkeypatch)
    monkeypatch.setattr("contid.control.daemon.run.ControlChild", lambda spawned: io.StringIO())
    with pytest.raises(ContidError, match="at most"):
        run(RunRequest("finger", mock=True, rate_hz=500.0))


def test_check_prints_shares_and_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    burn(monkeypatch)
    monkeypatch.setattr("contid.control.daemon.measured_run.LEAST_TICKS", 4)

    def short(
        loaded: LoadedFile, rate_hz: float, virtual_s: float, longest_s: float, records: Sink
    ) -> Budget:
        return measure_budget(loaded, rate_hz, 0.1 * virtual_s, 0.3 * longest_s, records=records)

    monkeypatch.setattr("contid_sessions.tick_budget.measure_budget", short)
    done = CliRunner().invoke(command, ["hand", "--budget", "--json"])
    assert done.exit_code == 2  # 4 ms of 5, and the wire takes 0.9
    budget = json.loads(done.stdout)["budget"]
    assert "a tick takes" in budget["refusal"]
    motions = budget["motions"]
    assert list(motions) == ["hold", "path", "stream"]
    assert all(each["robots_s"]["left"] >= BURNT_S for each in motions.values())


def test_a_look_leaves_no_trace_and_calls_no_foreign_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    loaded = parse_robot_file(fingers(1, options=f"journal_file: {journal}"), "r.yaml")
    check_budget(loaded, 200.0, "stream")
    assert not journal.exists()
    monkeypatch.setattr("contid.control.daemon.tick_times.robot_classes", dict)
    monkeypatch.setattr("contid.control.daemon.tick_times.measure_budget", pytest.fail)
    check_budget(loaded, 200.0, "stream")
