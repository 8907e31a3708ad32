"""Every goto ends once, and the gotos of a robot in their order, also while an axis is not there yet."""

from __future__ import annotations

import pytest

from contid.control.engine.events.robots import GotoEnded
from contid.control.engine.messages import Goto, Hold
from contid.targets import Target
from tests.control.engine.streamed import Run, middle


def arriving() -> tuple[Run, Target]:
    """A pneumatic arm in the tick in which its command is at the target of its first goto, its body not."""
    run = Run("stiffflop1")
    target = Target(tip_m=run.config.frame.point_in_world(middle(run)))
    run.engine.obey(Hold(), run.process.tick)
    run.tick()
    run.engine.obey(Goto(run.config.name, target), run.process.tick)
    while run.engine.robots.states[0].goto is not None:
        run.tick()
    assert not ended(run)
    return run, target


def ended(run: Run) -> list[GotoEnded]:
    return [event for event in run.events if isinstance(event, GotoEnded)]


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_a_second_goto_to_the_target_of_a_waiting_one_ends_both(ticks: int) -> None:
    run, target = arriving()
    for _ in range(ticks):
        run.tick()
    run.engine.obey(Goto(run.config.name, target), run.process.tick)
    for _ in range(1000):
        run.tick()
    assert [event.arrived for event in ended(run)][1:] == [True]


def test_a_waiting_goto_ends_before_one_that_is_dropped_at_once() -> None:
    """Clients tell them apart by their order; only the first has axes that are on their way."""
    run, target = arriving()
    run.engine.obey(Goto(run.config.name, target), run.process.tick)
    run.engine.obey(Hold(), run.process.tick)
    for _ in range(1000):
        run.tick()
    assert [bool(event.message) for event in ended(run)] == [True, False]
    assert [event.arrived for event in ended(run)] == [False, False]
