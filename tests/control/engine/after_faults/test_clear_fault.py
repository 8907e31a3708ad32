"""A fault that is cleared is over, or the refusal has what is still wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from contid.control.engine.messages import ClearFault, Mark, Message
from tests.support.fingers import Collector, load, run_virtual

RATE = 200.0
#: The robot is armed by then, and a fault at `FAULTY_S` is found before `CLEARED`.
FAULTY_S = 0.5
CLEARED = 240


def run(fault: str, orders: Mapping[int, Sequence[Message]], ticks: int = 320, **keys: str) -> Collector:
    """An attended run of a finger with a fault of its left axis."""
    options = f"watchdog_ms: 5000\nfaults:\n  - {{at_s: {FAULTY_S}, axis: f0.left, {fault}}}\n"
    loaded = load(1, options=options, **keys)
    seen = Collector(loaded)
    script: dict[int, Sequence[Message]] = {1: [Mark(0)], **orders}
    run_virtual(loaded, RATE, None, sinks=[seen], orders=script, ticks=ticks)
    return seen


@pytest.mark.parametrize("on_fault", ["hold", "relax"])
@pytest.mark.parametrize("fault", ["kind: jump, by_deg: 15", "kind: leak, share: 0.95"])
def test_a_robot_that_was_moved_is_cleared_where_it_is(fault: str, on_fault: str) -> None:
    """What is measured after the fault is no deviation from a command before it."""
    seen = run(fault, {CLEARED: [ClearFault()]}, on_fault=on_fault)
    modes = seen.modes("f0")
    assert modes[-2:] == ["FAULT", "READY"], modes


def test_a_fault_is_not_cleared_while_an_axis_repeats_old_data() -> None:
    seen = run("kind: stale", {CLEARED: [ClearFault()]})
    assert seen.modes("f0")[-1] == "FAULT"
    assert seen.modes("f0").count("FAULT") == 1
    refused = [str(event["message"]) for event in seen.events if event["event"] == "refused"]
    assert len(refused) == 1
    assert "f0: not cleared, f0.left repeats a measurement that is 0." in refused[0]


def test_it_is_cleared_once_the_data_are_fresh() -> None:
    seen = run("kind: stale, for_s: 0.6", {CLEARED: [ClearFault()]})
    assert seen.modes("f0")[-2:] == ["FAULT", "READY"]
