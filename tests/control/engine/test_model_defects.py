"""A wrong answer of one robot's model costs that robot only, reported by its own message, whatever it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from contid.control.engine.messages import Begin, Estop, Grip, Hold, Message, Stop
from contid.control.tick.supervisor import Mode
from tests.support.broken.broken_run import (
    BROKEN_FROM,
    END,
    MODELS,
    BrokenRun,
    StreamedRun,
    fail,
    good_of,
    ordered,
    unharmed,
)  # fmt: skip


@pytest.fixture(scope="module")
def sound() -> list[str]:
    return good_of(BrokenRun())


@pytest.fixture(scope="module")
def sound_stream() -> list[str]:
    return good_of(StreamedRun())


def changed(**fields: Any) -> Callable[[Any], Callable[..., Any]]:
    """A model whose answers have other fields."""
    return lambda model: lambda target, seed: replace(model.inverse(target, seed), **fields)


ANSWERS: dict[str, tuple[Callable[[Any], Callable[..., Any]], str]] = {
    "too few axes": (changed(actuation=(0.05,)), "(0.05,) for 2 axes"),
    "too many axes": (changed(actuation=(0.05,) * 3), "0.05, 0.05) for 2 axes"),
    "no axes": (changed(actuation=()), "() for 2 axes"),
    "NaN": (changed(actuation=(math.nan, 0.05)), "nan"),
    "text as an axis": (changed(actuation=("left", 0.05)), "left"),
    "None as residual": (changed(residual_m=None), "None"),
    "text as residual": (changed(residual_m="small"), "small"),
    "None as iterations": (changed(iterations=None), "None"),
    "numbers as limits": (changed(limited_by=(7,)), "7"),
}


#: Each is found where another one is that CI tries.
ALIKE = ("both raise", "no axes", "text as residual")
#: Every defect with one reaction of the robot; what a fault does does not ask for its cause.
DEFECTS = (
    [(kind, "hold") for kind in (*MODELS, *ANSWERS) if kind not in ALIKE]
    + [*(pytest.param(kind, "hold", marks=pytest.mark.campaign) for kind in ALIKE)]
    + [
        pytest.param(kind, "relax", marks=() if kind in ("inverse raises", "NaN") else pytest.mark.campaign)
        for kind in (*MODELS, "NaN", "None as residual")
    ]
)


@pytest.mark.parametrize(("kind", "on_fault"), DEFECTS)
def test_a_defect_of_a_model_costs_its_robot_only(sound: list[str], kind: str, on_fault: str) -> None:
    run = BrokenRun(on_fault)
    broken, words = MODELS.get(kind, ({}, ""))
    if kind in ANSWERS:
        change, words = ANSWERS[kind]
        broken = {"inverse": change(run.process.engine.robots.configs[1].model)}
    run.break_model(**broken)
    records = run.go()
    assert unharmed(records, sound)
    assert words in run.fault()[1]
    assert {record.robots[1].mode for record in records[BROKEN_FROM + 1 :]} == {Mode.FAULT}
    if on_fault == "relax":
        return
    # It stops as fast as its limits allow, and not faster: no command is left out on the way.
    config = run.process.engine.robots.configs[1]
    for axis, limits in enumerate(config.limits):
        commands = [record.robots[1].axes[axis].command for record in records[BROKEN_FROM - 5 :]]
        steps = [after - before for before, after in pairwise(commands)]
        changes = [abs(after - before) for before, after in pairwise(steps)]
        assert max(changes) <= limits.change * 1.0001
        assert not any(steps[-END:])


@pytest.mark.parametrize("order", [Hold(), Stop(), Estop(), Grip(0.5), Begin()])
def test_an_order_that_meets_a_defect_ends_nothing(order: Message) -> None:
    """A stop of a robot in motion asks its model; the others obey, and an emergency stop is obeyed by all."""
    run = BrokenRun()
    run.break_model(inverse=fail, forward=fail)
    states = ordered(run, order)
    assert states[0].mode is (
        Mode.RUN if isinstance(order, Grip) else Mode.HOLD if order in (Hold(), Begin()) else Mode.OFF
    )
    assert states[1].mode is (Mode.OFF if order == Estop() else Mode.FAULT)
    assert states[1].enabled is not isinstance(order, Stop | Estop)


@pytest.mark.parametrize(
    "kind",
    [
        each
        if each in ("both raise", "inverse answers None")
        else pytest.param(each, marks=pytest.mark.campaign)
        for each in MODELS
    ],
)
def test_a_model_that_fails_at_a_row_costs_its_robot_only(sound_stream: list[str], kind: str) -> None:
    """A row that jumps asks the model for a way, before the tick."""
    run = StreamedRun()
    run.break_model(**MODELS[kind][0])
    records = run.go()
    assert unharmed(records, sound_stream)
    assert any(words in run.fault()[1] for words in (MODELS[kind][1], "'str'"))
    assert not [event for event in run.collector.events if event["event"] == "refused"]
