"""A handful of faults on wires, in real time; ``python -m tests.campaign --ptys 60`` is the long form."""

from __future__ import annotations

import os
import random

import pytest

from tests.campaign.wired.bugs import BUGS
from tests.campaign.wired.cases import Run, campaign
from tests.campaign.wired.checks import STATES, Tally

CASES = int(os.environ.get("CONTID_CAMPAIGN_PTYS", "4"))
# Against real time: a machine that stands still for a tenth of a second looks like a dead bus.
pytestmark = [pytest.mark.campaign, pytest.mark.realtime]


def test_no_fault_on_wires_makes_anything_unsafe() -> None:
    tally = campaign(CASES, seed=int(os.environ.get("CONTID_CAMPAIGN_SEED", "1")))
    print(tally.table())
    assert tally.cases == CASES
    assert not sum(tally.violations.values()), "\n".join(tally.message)


def test_no_fault_on_the_wires_of_a_tendon_robot_makes_anything_unsafe() -> None:
    tally = Tally(seed=1)
    Run(random.Random(1), tally, 1).play(2)
    print(tally.table())
    assert tally.cases == 2
    assert not sum(tally.violations.values()), "\n".join(tally.message)


def test_estop_relaxes_servos_and_motors_and_empties_chambers_in_every_state() -> None:
    tally = Tally(seed=1)
    Run(random.Random(1), tally, 0).stop_everywhere(STATES)
    print(tally.table())
    assert tally.checks["estop at the devices"] >= len(STATES)
    assert not sum(tally.violations.values()), "\n".join(tally.message)


@pytest.mark.parametrize("state", STATES if os.environ.get("CONTID_CAMPAIGN") else ("approach", "stopping"))
def test_a_second_ctrl_c_does_the_same(state: str) -> None:
    tally = Tally(seed=1)
    Run(random.Random(1), tally, 0).interrupt_twice(state)
    print(tally.table())
    assert tally.checks["estop at the devices"] == 1
    assert not sum(tally.violations.values()), "\n".join(tally.message)


@pytest.mark.parametrize("seed", [1, 4])
def test_what_a_healed_encoder_leaves_behind_is_of_its_own_case(seed: int) -> None:
    """The shaft went on while the encoder stood still: the position jumps, and its turn is refused."""
    tally = Tally(seed)
    run = Run(random.Random(seed), tally, 0, driver="dynamixel")
    states = run.throw("run", "hand_servos", "freeze", "hand_right.right")
    assert not sum(tally.violations.values()), "\n".join(tally.message)
    assert {robot for robot, state in states.items() if state == "FAULT"} == run.lost


@pytest.mark.parametrize("bug", BUGS)
def test_a_deliberate_bug_is_found_at_the_devices(bug: str) -> None:
    tally = Tally(seed=1)
    Run(random.Random(1), tally, 0, BUGS[bug]).stop_everywhere(["approach"])
    assert tally.violations["estop at the devices"] + tally.violations["estop within the tick"]
