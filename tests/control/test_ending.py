"""A run that shall end is pressed on in time, and never before."""

from __future__ import annotations

from contid.control.daemon.shutdown import END_S, PATIENCE_S, Escalation, ShutdownSequence


def test_nothing_is_due_while_nobody_asked() -> None:
    ending = ShutdownSequence()
    ending.takes(0.0, 1.0)
    assert ending.due(1e9) is Escalation.NOTHING


def test_a_stop_that_is_not_heard_of_is_pressed_on_and_then_killed() -> None:
    ending = ShutdownSequence()
    ending.stop(10.0)
    assert ending.due(10.0 + PATIENCE_S) is Escalation.NOTHING
    late = 10.0 + PATIENCE_S + 0.01
    assert ending.due(late) is Escalation.RELAX
    ending.relax(late)
    assert ending.due(late + END_S) is Escalation.NOTHING
    assert ending.due(late + END_S + 0.01) is Escalation.KILL
    assert PATIENCE_S + END_S < 2.0, "people wait no longer"


def test_a_motion_gets_the_time_that_it_says_it_takes() -> None:
    ending = ShutdownSequence()
    ending.stop(0.0)
    ending.takes(5.0, 0.1)
    assert ending.due(5.1 + PATIENCE_S) is Escalation.NOTHING
    assert ending.due(5.2 + PATIENCE_S) is Escalation.RELAX
