"""Motions that a walk only adds up: it refuses what a walk refuses that looks at every pair in every step."""

import numpy as np
import pytest

from contid.robot_file.load import load_named, with_mock
from contid.targets import ZERO3
from contid.trajectory.straight_stop import StraightStop
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.walk import Walk
from tests.campaign.script import close_hand

SIDES = np.array([-1.0, 1.0])


class Looking(Walk):
    """A walk that adds nothing up."""

    def _moved_with(self, motions):
        super()._moved_with(motions)


@pytest.mark.parametrize("as_before", [False, True])
@pytest.mark.parametrize("close", [False, True])
def test_a_walk_refuses_as_one_that_looks_at_every_pair_in_every_step(close: bool, as_before: bool) -> None:
    guard = clearance_guard(with_mock(close_hand() if close else load_named("hand")))
    assert guard is not None
    if as_before:
        guard.ask_as_before()
    start = {name: (guard.rest[name], ZERO3) for name in guard.arms}
    walk, looking = Walk(guard, start), Looking(guard, start)
    rng = np.random.default_rng(3)
    moved, refused, added = {name: np.array(guard.rest[name]) for name in guard.arms}, 0, 0
    for step in range(120):
        if step % 30 == 0:  # towards a pose with any bend
            poses = {name: rng.uniform(0.04, 0.09) + rng.uniform(-0.02, 0.02) * SIDES for name in moved}
            steps = {name: (pose - moved[name]) / (30.0 if close else 600.0) for name, pose in poses.items()}
        names = [name for name in guard.arms if rng.random() < 0.8]
        goal = {name: (tuple((moved[name] + steps[name]).tolist()), ZERO3) for name in names}
        message = walk.to(goal)
        assert message == looking.to(goal)
        assert walk.configuration == looking.configuration
        ends = [(0.0, 0.2)] * 2
        stops = {
            name: StraightStop(each[0], tuple(steps[name].tolist()), (2e-4, 2e-4), ends, 0.005)
            for name, each in walk.configuration.items()
        }
        assert walk.stops(stops) == looking.stops(stops)
        refused += bool(message)
        added += any(each.way_m for each in walk._moved.values())
        if not message:
            moved |= {name: np.array(each[0]) for name, each in goal.items()}
    assert refused > 3 if close else added > 30
