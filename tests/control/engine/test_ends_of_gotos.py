"""Every goto ends once, and the gotos of a robot in their order, also while an axis is not there yet."""

from __future__ import annotations

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.robots import GotoEnded
from contid.control.engine.messages import Goto, Hold
from contid.control.engine.virtual import VirtualProcess
from contid.robot_file.load import load_named, parse_robot_file, with_mock
from contid.targets import Target
from contid_contact.stage import ContactStage
from tests.control.engine.streamed import Run, middle
from tests.support.fingers import Collector

REST = "    rest_mm: [60, 60]\n"


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
    """Clients know them by their order; only the first has axes that are on their way."""
    run, target = arriving()
    run.engine.obey(Goto(run.config.name, target), run.process.tick)
    run.engine.obey(Hold(), run.process.tick)
    for _ in range(1000):
        run.tick()
    assert [bool(event.message) for event in ended(run)] == [True, False]
    assert [event.arrived for event in ended(run)] == [False, False]


def test_gotos_while_a_robot_goes_back_from_a_contact_end_too() -> None:
    """One was interrupted by the contact, one came while it brakes, and one replaced that before a tick."""
    sense = "{contact: retract, usual_ma: 900, contact_ma: 600, nm_per_a: 0.354}"
    loaded = with_mock(
        parse_robot_file(load_named("finger").text.replace(REST, f"{REST}    sense: {sense}\n"), "f")
    )
    seen = Collector(loaded)
    process = VirtualProcess(loaded, 200.0, seen, on_end=OnEnd.HOLD, attended=True)
    stages = [getattr(each, "__self__", each) for each in process.engine._before]
    (stage,) = [each for each in stages if isinstance(each, ContactStage)]
    there, here = Target(tip_m=(0.045, 0.08, 0.0)), Target(tip_m=(0.05, 0.075, 0.0))
    process.engine.arm()
    while process.tick < 1200:
        process.begin()
        if process.tick == 100:
            process.engine.obey(Hold(), process.tick)
            process.engine.obey(Goto("finger", there), process.tick)
        if process.tick == 140:
            stage.react(0, process.tick / 200.0, "a contact", process.tick / 200.0)
        if process.tick == 141:
            assert stage.going_back == {0: None}
            for order in (Goto("finger", here), Goto("finger", there), Hold()):
                process.engine.obey(order, process.tick)
        if process.tick == 600:
            process.engine.obey(Goto("finger", here), process.tick)
        process.turn()
    ends = [(event["tick"], event["arrived"]) for event in seen.events if event["event"] == "goto"]
    assert [arrived for _, arrived in ends] == [False, False, False, True]
    assert {tick for tick, _ in ends[:3]} <= {141, 142}
