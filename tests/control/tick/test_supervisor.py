"""Every state, every event: what happens, and that nothing else does."""

from __future__ import annotations

from itertools import product

import pytest

from contid.control.tick.faults import PAGES, Fault, describe
from contid.control.tick.supervisor import MOVES, REST_OF, Event, Mode, allowed, move
from contid.robot_file.base import StopPolicy

EXPECTED = {
    Mode.OFF: {Event.CONNECT: Mode.CONNECTING, Event.FAULT: Mode.FAULT},
    Mode.CONNECTING: {
        Event.SAMPLED: Mode.READY,
        Event.STOP: Mode.OFF,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.READY: {
        Event.ARM: Mode.ARMING,
        Event.STOP: Mode.OFF,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.ARMING: {
        Event.ARMED: Mode.APPROACH,
        Event.HOLD: Mode.HOLD,
        Event.STOP: Mode.STOPPING,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.APPROACH: {
        Event.ARRIVED: Mode.RUN,
        Event.HOLD: Mode.HOLD,
        Event.STOP: Mode.STOPPING,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.RUN: {
        Event.HOLD: Mode.HOLD,
        Event.FOLLOW: Mode.APPROACH,
        Event.STOP: Mode.STOPPING,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.HOLD: {
        Event.FOLLOW: Mode.APPROACH,
        Event.RECOVER: Mode.APPROACH,
        Event.STOP: Mode.STOPPING,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.STOPPING: {
        Event.STOPPED: Mode.OFF,
        Event.STOP: Mode.STOPPING,
        Event.ESTOP: Mode.OFF,
        Event.FAULT: Mode.FAULT,
    },
    Mode.FAULT: {
        Event.CLEAR: Mode.READY,
        Event.RECOVER: Mode.READY,
        Event.STOP: Mode.FAULT,
        Event.ESTOP: Mode.FAULT,
    },
}


@pytest.mark.parametrize(("mode", "event"), list(product(Mode, Event)))
def test_every_state_and_event(mode: Mode, event: Event) -> None:
    assert move(mode, event) == EXPECTED[mode].get(event)


def test_only_clear_and_recover_leave_a_fault_and_only_through_arming() -> None:
    leaving = {event: mode for (start, event), mode in MOVES.items() if start is Mode.FAULT}
    assert leaving == EXPECTED[Mode.FAULT]
    assert set(leaving.values()) == {Mode.READY, Mode.FAULT}


def test_motion_is_reached_through_arming_only() -> None:
    """No path from OFF to a commanding state that does not pass ARMING."""
    commanding = {Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING}
    seen, todo = {Mode.OFF}, [Mode.OFF]
    while todo:
        here = todo.pop()
        for (start, _), end in MOVES.items():
            if start is here and end not in seen and end is not Mode.ARMING:
                seen.add(end)
                todo.append(end)
    assert not seen & commanding


def test_every_policy_ends_in_a_rest_of_the_device() -> None:
    assert set(REST_OF) == set(StopPolicy)


def test_refusals_can_name_what_is_possible() -> None:
    assert allowed(Mode.FAULT) == ("stop", "estop", "clear-fault", "recover")


@pytest.mark.parametrize("fault", [f for f in Fault if f is not Fault.NONE])
def test_every_fault_has_its_page(fault: Fault) -> None:
    page = PAGES[fault]
    assert page.cause
    assert page.reaction
    assert describe(fault, "left is silent").startswith(f"fault {int(fault)} ")
