"""Escalation of a shutdown happens at its deadlines and not before."""

from __future__ import annotations

from contid.control.daemon.shutdown import KILL_GRACE_S, STOP_GRACE_S, Escalation, ShutdownSequence


def test_nothing_is_due_without_a_request() -> None:
    shutdown = ShutdownSequence()
    shutdown.stop_takes(0.0, 1.0)
    assert shutdown.due(1e9) is Escalation.NOTHING


def test_a_stop_without_report_escalates_to_relax_and_then_kill() -> None:
    shutdown = ShutdownSequence()
    shutdown.stop(10.0)
    assert shutdown.due(10.0 + STOP_GRACE_S) is Escalation.NOTHING
    late = 10.0 + STOP_GRACE_S + 0.01
    assert shutdown.due(late) is Escalation.RELAX
    shutdown.relax(late)
    assert shutdown.due(late + KILL_GRACE_S) is Escalation.NOTHING
    assert shutdown.due(late + KILL_GRACE_S + 0.01) is Escalation.KILL
    assert STOP_GRACE_S + KILL_GRACE_S < 2.0, "a user presses Ctrl-C again after 2 s"


def test_the_reported_stopping_time_is_granted() -> None:
    shutdown = ShutdownSequence()
    shutdown.stop(0.0)
    shutdown.stop_takes(5.0, 0.1)
    assert shutdown.due(5.1 + STOP_GRACE_S) is Escalation.NOTHING
    assert shutdown.due(5.2 + STOP_GRACE_S) is Escalation.RELAX


def test_pressing_ctrl_c_again_and_again_does_not_postpone_the_end() -> None:
    shutdown = ShutdownSequence()
    shutdown.stop(0.0)
    for press in range(1, 10):
        shutdown.relax(0.2 * press)
    assert shutdown.due(0.21 + KILL_GRACE_S) is Escalation.KILL
