"""Damaged bodies are found in time, sound ones never; short form of `tests.campaign.bodies`."""

from __future__ import annotations

import random

import pytest

from contid.control.tick.faults import Fault
from contid.robot_file.load import find_robot_file, load_robot_file
from tests.campaign.bodies.damaged_bodies import ROBOTS
from tests.campaign.bodies.damages import faults_of
from tests.campaign.bodies.plants import axes_of
from tests.campaign.bodies.watched_runs import run

pytestmark = pytest.mark.campaign

#: A body that is slower than it was, or sticks, hides in the lag that its class of device may have.
HIDDEN = frozenset({"slow", "friction x3"})


@pytest.mark.parametrize("robot", ROBOTS)
def test_damage_is_found_in_time(robot: str) -> None:
    axes = axes_of(load_robot_file(find_robot_file(robot)))[0]
    late = []
    for kind in faults_of(axes):
        draw = random.Random(f"{robot} {kind}")
        runs = [run(axes, draw, 14.0, kind)[0] for _ in range(3)]
        late += [kind for each in runs if each.counted_s is not None and not each.in_time]
    assert len([kind for kind in late if kind not in HIDDEN]) <= 1
    assert len(late) <= 3


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_sound_body_is_never_reported(robot: str) -> None:
    axes = axes_of(load_robot_file(find_robot_file(robot)))[0]
    _, watched, lasted_s = run(axes, random.Random(robot), 60.0, None)
    assert watched.fault is Fault.NONE, watched.message
    assert lasted_s > 59.0
