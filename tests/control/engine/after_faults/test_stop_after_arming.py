"""A stop that takes power away does so for devices that an arming left with it, in every state after it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from contid.control.engine.messages import ClearFault, Estop, Finish, Mark, Message, Resume, Stop
from contid.robot_file.load import parse_robot_file
from tests.support.fingers import Collector, fingers, run_virtual

RATE = 200.0
#: Armed again in tick 101, in which the device of the right axis has just failed.
OVERLOAD = "{at_s: 0.5025, kind: overload, axis: f0.right, for_s: 0.2}"
BEFORE: Mapping[int, Sequence[Message]] = {1: [Mark(0)], 60: [Estop()], 101: [Resume()], 150: [ClearFault()]}


def run(folder: Path, orders: Mapping[int, Sequence[Message]]) -> tuple[list[str], dict[str, str]]:
    """States of a finger with its axes on two buses, and the rest of each device at the end."""
    journals = [folder / f"{bus}.jsonl" for bus in ("bus0", "bus1")]
    options = f"journal_file: {journals[0]}\nwatchdog_ms: 5000"
    text = fingers(1, buses=2, options=options, on_fault="hold", on_interrupt="relax")
    text = text.replace("right: {bus: bus0", "right: {bus: bus1")
    second = f"  bus1:\n    watchdog_ms: 5000\n    journal_file: {journals[1]}\n    faults: [{OVERLOAD}]\n"
    loaded = parse_robot_file(text.replace("  bus1:\n", second), "fingers.yaml")
    seen = Collector(loaded)
    run_virtual(loaded, RATE, None, sinks=[seen], orders={**BEFORE, **orders}, ticks=250)
    rests: dict[str, str] = {}
    for journal in journals:
        last = json.loads(journal.read_text().splitlines()[-1])
        rests |= {axis: state["rest"] for axis, state in last["axes"].items()}
    return seen.modes("f0"), rests


@pytest.mark.parametrize("order", [Stop(), Finish()])
def test_devices_that_hold_since_an_arming_that_failed_are_relaxed(order: Message, tmp_path: Path) -> None:
    modes, rests = run(tmp_path, {170: [order]})
    assert modes[-3:] == ["FAULT", "READY", "OFF"]
    assert rests == {"f0.left": "relax", "f0.right": "relax"}


def test_without_an_order_they_hold(tmp_path: Path) -> None:
    modes, rests = run(tmp_path, {})
    assert (modes[-1], rests["f0.left"]) == ("READY", "hold")
