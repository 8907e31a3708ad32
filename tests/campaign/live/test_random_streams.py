"""Random live streams keep every limit and end at rest on their last row, in a short form."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.campaign.live.random_streams import ROBOTS, campaign, rows_of, staged, violations

#: Streams that exceeded the jerk of their robot by 2.6 to 24 times, or did not come to rest.
FOUND = (
    ("stiffflop1", 2000195),  # a valve that closes ended 1e-6 Pa beyond its limit
    ("stiffflop1", 2000393),  # a stop of an axis that accelerates
    ("trirack", 1000015),  # a stop that crosses a bend radius early
    ("trirack2", 1000003),  # a way along a bend radius
    ("stiffflop1", 4000307),  # rows that became slower: the curve was played backwards and never came to rest
)


@pytest.mark.parametrize(("robot", "number"), FOUND)
def test_streams_that_exceeded_a_limit_keep_it(robot: str, number: int) -> None:
    stage = staged(robot)
    assert violations(stage, rows_of(stage, number)) == {}


def test_a_recording_of_rules_1_goes_on_as_it_was() -> None:
    """By its rules the first of these streams exceeds the jerk, by as much as when it was found."""
    stage = staged("stiffflop1")
    before = stage._replace(config=replace(stage.config, motion_rules=1))
    assert violations(before, rows_of(stage, 2000195))["jerk"] == pytest.approx(24.347013, rel=1e-4)


def test_random_streams_keep_every_limit_and_end_on_their_last_row() -> None:
    tally = campaign(("finger", "cbha"), 4, seed=5)
    assert not tally.counts, tally.table()
    assert tally.streams.total() == 4


@pytest.mark.campaign
def test_streams_of_every_robot() -> None:
    tally = campaign(ROBOTS, 400, seed=6)
    assert not tally.counts, tally.table()
